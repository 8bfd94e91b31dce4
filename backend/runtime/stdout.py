"""Keeps Blender's own chatter (`Fra:1 Mem:...`, `Saved: ...`, `Error: ...`) out of a command's output.

Most of it is written to file descriptor 1 from C, the reports of operators to Python's `sys.stdout`.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def blender_silenced() -> Iterator[None]:
    """Within, nothing reaches stdout; stderr is left alone."""
    sys.stdout.flush()
    _flush_c()
    terminal = os.dup(1)
    try:
        with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.redirect_stdout(nowhere):
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        _flush_c()  # what C still holds belongs to the silence, or it would come out at exit
        os.dup2(terminal, 1)
        os.close(terminal)


def _flush_c() -> None:
    with contextlib.suppress(OSError, TypeError, AttributeError):  # Windows: no such handle on the C library
        ctypes.CDLL(None).fflush(None)
