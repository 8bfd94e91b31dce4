"""The process that a `PersonJob` starts."""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
from typing import Any

from ..records.errors import LiveHandError
from .command import COMMAND, making


def run() -> None:
    """Make the person of the arguments in `sys.argv[2]`, and write what happens to the standard output."""
    threading.Thread(target=_end_with_parent, name="livehand parent", daemon=True).start()
    parser = argparse.ArgumentParser(COMMAND.name)
    COMMAND.add_arguments(parser)
    arguments = parser.parse_args(json.loads(sys.argv[2]))
    try:
        _write(dict(making(arguments, lambda line: _write({"progress": line}))))
    except LiveHandError as error:
        _write({"error": str(error)})
    except MemoryError:
        _write({"error": "the avatar needs more memory than is free; close other programs, or give fewer pictures"})


def _write(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def _end_with_parent() -> None:
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)
