"""How kernels are compiled, kept, and run on several threads.

Kernels release the GIL and run on plain Python threads: numba's own threading layers must not be entered from two
threads at once, which Blender does (a render beside the viewport).
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config

# Pieces of work per thread: enough that a thread with the heavier pixels does not keep the others waiting.
_CHUNKS_PER_THREAD = 8


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code, with exactly the arithmetic it states."""
    return _compiled(function, fastmath=False)


def compiled_loosely(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code that may reorder sums and fuse products: for features, not for geometry."""
    return _compiled(function, fastmath={"reassoc", "contract", "nsz", "arcp"})


def _compiled(function: Callable[..., Any], fastmath: bool | set[str]) -> Callable[..., Any]:
    """Compile, and keep the code on disk between runs.

    numba's own check looks at one file only, and would run old code when a kernel calls one from another file that has
    changed: so the folder is named after the text of all kernels.
    """
    previous = config.CACHE_DIR
    config.CACHE_DIR = str(_cache_folder(previous))
    try:
        plain = inspect.unwrap(function)  # without the type checker that the tests wrap around everything
        return numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=fastmath, forceinline=True)(plain)
    finally:
        config.CACHE_DIR = previous


def in_parallel(run: Callable[[int, int], Any], count: int, threads: int) -> None:
    """Call run(first, last) for ranges that together are [0, count), on so many threads."""
    if threads == 1 or count < threads * _CHUNKS_PER_THREAD:
        run(0, count)
        return
    size = -(-count // (threads * _CHUNKS_PER_THREAD))
    starts = range(0, count, size)
    list(_pool(threads).map(run, starts, (min(start + size, count) for start in starts)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="livehand-kernels")


@cache
def _cache_folder(asked: str) -> Path:
    sources = sorted(Path(__file__).parent.glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    home = Path(asked or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "livehand" / f"kernels-{digest}"
