"""How kernels are compiled, and kept."""

from __future__ import annotations

import contextlib
import inspect
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import ModuleRef
from numba.core import config
from numba.core.codegen import CPUCodegen, JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher
from numba.core.options import DefaultOptions
from numba.core.registry import CPUDispatcher

from .cache_folder import kernel_folder_name, writable_cache

_LOOSE = {"reassoc", "contract", "nsz", "arcp"}
_WITHOUT_PYTHON = "no_cpython_wrapper"
_UNCOUNTED = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile the function to machine code, with strict floating-point arithmetic."""
    return _compiled(function, fastmath=False)


def compiled_loosely(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile the function to machine code that may reorder sums and contract products: for features, not geometry."""
    return _compiled(function, fastmath=_LOOSE)


def compiled_part(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as `compiled` a function that kernels alone call and that makes no arrays.

    References are not counted in it, which takes a third of the march's time; a numba without the option counts them.
    It is kept as a part of its kernels only, and Python cannot call it: both would take a fifth of the compiler's time.
    Nor is it optimized by itself (`_PartLibrary`).
    """
    return _compiled(function, fastmath=False, is_part=True)


def compiled_part_loosely(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as `compiled_loosely` and `compiled_part` do."""
    return _compiled(function, fastmath=_LOOSE, is_part=True)


def _compiled(function: Callable[..., Any], fastmath: bool | set[str], is_part: bool = False) -> Callable[..., Any]:
    plain = inspect.unwrap(function)  # without the type checker that the tests wrap around everything
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": fastmath, "forceinline": True}
    settings["no_cfunc_wrapper"] = True  # which only C would call
    if is_part:
        return KernelPart.of(plain, {"nopython": True, _WITHOUT_PYTHON: True, **_UNCOUNTED, **settings})
    with disk_cache() as has_cache:
        return numba.njit(cache=has_cache, **settings)(plain)


class KernelPart(CPUDispatcher):
    """What kernels call and Python cannot: numba would jump to an entry that is not there, and end the process."""

    @classmethod
    def of(cls, function: Callable[..., Any], options: dict[str, Any]) -> KernelPart:
        """Make a part of a function, with numba's options."""
        return cls(function, targetoptions=options, pipeline_class=_PartCompiler)

    def __call__(self, *args: Any, **named: Any) -> None:
        """Raise TypeError."""
        name = self.py_func.__name__
        raise TypeError(f"'{name}' is a part of kernels, which they alone call; decorate it as a kernel")


class _PartCompiler(Compiler):
    """Compiles a part into a library of its own kind."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes."""
        state = self.state
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


class _PartLibrary(JITCodeLibrary):
    """A part's code as numba writes it, to be linked into the libraries of kernels.

    Numba would optimize every part by itself and make machine code of it, and again in all kernels that call it: a
    tenth of the time of compiling.
    """

    def _optimize_functions(self, ll_module: ModuleRef) -> None:
        ll_module.data_layout = self._final_module.data_layout  # as numba's own does

    def _optimize_final_module(self) -> None:
        """Leave it to the kernels."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What numba tells of the part's environment, which machine code would have."""
        return _WithoutEnvironments(self._codegen)


class _WithoutEnvironments:
    """A code generator for code that raises no errors and so needs no environment."""

    def __init__(self, codegen: CPUCodegen):
        self._codegen = codegen

    def set_env(self, env_name: str, env: Any) -> None:
        """Do nothing."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


@contextlib.contextmanager
def disk_cache() -> Iterator[bool]:
    """Let numba keep the machine code of new functions on disk inside the context; yields whether it can."""
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
    home = writable_cache(configured)
    return home and home / kernel_folder_name()


def kernel_counts() -> tuple[int, int]:
    """Count the kernels that have machine code, and all of those that are imported; parts of kernels do not count."""
    loaded = [module for name, module in sys.modules.items() if name.startswith(f"{__package__}.")]
    found = {id(one): one for module in loaded for one in vars(module).values() if isinstance(one, Dispatcher)}
    kernels = [one for one in found.values() if not isinstance(one, KernelPart)]
    return sum(bool(kernel.signatures) for kernel in kernels), len(kernels)
