"""The `livehand` program: what libraries read as they are loaded, then its command."""

from __future__ import annotations

from typing import NoReturn

from ..backend.system.process_end import run_process
from ..backend.system.thread_limits import limit_blas


def program() -> NoReturn:
    """Run the command of the program's arguments, and end the process."""
    limit_blas()
    run_process(_main)


def _main() -> int:
    from .cli import main  # imports numpy

    return main()


if __name__ == "__main__":
    program()
