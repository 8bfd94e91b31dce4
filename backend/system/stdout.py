"""The process's standard streams: there even if its parent closed them, and free of Blender's own messages."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Generator


@contextlib.contextmanager
def blender_silenced() -> Generator[None, None, None]:
    """Inside the context, nothing reaches stdout, such as Blender's `Fra:1 Mem:...`; stderr is not changed.

    C code writes most of that to file descriptor 1; operators report to Python's `sys.stdout`.
    """
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


def open_standard_streams() -> None:
    """Open those that the parent closed. Else files that are opened would take their places, and get C's messages."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_RDWR), descriptor)
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, "w", encoding="utf-8", closefd=False))


def print_nowhere() -> None:
    """Let all that is printed from now on vanish, C's messages too."""
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)


def _flush_c() -> None:
    with contextlib.suppress(OSError, TypeError, AttributeError):  # Windows: no such handle on the C library
        ctypes.CDLL(None).fflush(None)
