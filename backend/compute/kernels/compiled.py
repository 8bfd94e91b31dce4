"""How kernels are compiled, and kept."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config
from numba.core.options import DefaultOptions

from .cache_folder import writable_cache

_LOOSE = {"reassoc", "contract", "nsz", "arcp"}
_UNCOUNTED = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile the function to machine code, with strict floating-point arithmetic."""
    return _compiled(function, fastmath=False)


def compiled_loosely(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile the function to machine code that may reorder sums and contract products: for features, not geometry."""
    return _compiled(function, fastmath=_LOOSE)


def compiled_part(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as `compiled` a function that kernels call and that makes no arrays: references are not counted in it.

    Counting takes a third of the march's time. A numba without the option counts them.
    """
    return _compiled(function, fastmath=False, **_UNCOUNTED)


def compiled_part_loosely(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as `compiled_loosely` and `compiled_part` do."""
    return _compiled(function, fastmath=_LOOSE, **_UNCOUNTED)


def _compiled(function: Callable[..., Any], fastmath: bool | set[str], **options: Any) -> Callable[..., Any]:
    with disk_cache() as has_cache:
        plain = inspect.unwrap(function)  # without the type checker that the tests wrap around everything
        settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": fastmath, "forceinline": True}
        return numba.njit(cache=has_cache, **settings, **options)(plain)


@contextlib.contextmanager
def disk_cache() -> Iterator[bool]:
    """Let numba keep the machine code of new functions on disk inside the context; yields whether it can.

    numba checks only the file of the kernel itself, and would run old code when a kernel calls a changed one from
    another file, so the folder is named after the text of all kernels. It is also named after this package, because a
    cached signature refers to the classes of its named tuples by their module's name.
    """
    options: dict[str, Any] = config.__dict__  # numba defines its options at run time
    previous = options["CACHE_DIR"]
    folder = _cache_folder(previous)
    options["CACHE_DIR"] = str(folder or previous)
    try:
        yield folder is not None
    finally:
        options["CACHE_DIR"] = previous


def kernel_folder() -> Path | None:
    """Return where machine code is kept; None: nowhere."""
    return _cache_folder(config.__dict__["CACHE_DIR"])


@cache
def _cache_folder(configured: str) -> Path | None:
    sources = sorted(Path(__file__).parent.glob("*.py"))
    text = b"".join(source.read_bytes() for source in sources)
    digest = hashlib.sha256(str(__package__).encode() + text).hexdigest()[:16]
    home = writable_cache(configured)
    return home and home / f"kernels-{digest}"
