"""Suppresses Blender's own messages (`Fra:1 Mem:...`, `Saved: ...`, `Error: ...`) in a command's output.

C code writes most of them to file descriptor 1; operators report to Python's `sys.stdout`.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Generator


@contextlib.contextmanager
def blender_silenced() -> Generator[None, None, None]:
    """Inside the context, nothing reaches stdout; stderr is not changed."""
    sys.stdout.flush()
    _flush_c()
    terminal = os.dup(1)
    try:
        with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.redirect_stdout(nowhere):
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        _flush_c()  # else C would print its buffer at exit
        os.dup2(terminal, 1)
        os.close(terminal)


def _flush_c() -> None:
    with contextlib.suppress(OSError, TypeError, AttributeError):  # Windows: no such handle on the C library
        ctypes.CDLL(None).fflush(None)
