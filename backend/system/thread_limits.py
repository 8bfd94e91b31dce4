"""What torch must be given before it is imported, and limits on its threads."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Generator

# Iterations of a waiting loop: the library's default is 300,000, which takes 8 ms and more.
_GNU_SPINS = "0"
_LLVM_BLOCK_MS = "0"
_BLAS_THREADS = "1"


def blas_settings() -> dict[str, str]:
    """Return the environment in which numpy's products and solvers take one thread; the user's own settings win.

    Ours are small. With two threads, on cores that other programs use, one waits for the other nearly all the time: the
    fit of a film's landmarks took thirty times as long.
    """
    return {"OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", _BLAS_THREADS)}


def limit_blas() -> None:
    """Make this process keep to `blas_settings`. Call it before numpy is imported."""
    os.environ.update(blas_settings())


def limit_spinning() -> None:
    """Make waiting threads yield their core. Call it before torch is imported; the user's own settings win.

    Otherwise torch's threads spin between operations, on cores that the kernels need, and wait for each other there if
    other programs hold a core: a frame on two crowded cores takes twice as long, a step of training too.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", _GNU_SPINS)
    os.environ.setdefault("KMP_BLOCKTIME", _LLVM_BLOCK_MS)


def allow_cpu_for_mps() -> None:
    """Let the CPU do what torch lacks for a Mac's GPU. Call it before torch is imported."""
    os.environ.setdefault("PYTORCH_ENABLE_MPS_FALLBACK", "1")


def usable_threads() -> int:
    """Count the threads that torch may use: `OMP_NUM_THREADS`, or the cores on which this process may run."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    if asked.isdecimal() and int(asked):
        return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_own = threading.local()
_usual: dict[
    int, int
] = {}  # of the threads that have other numbers for a while; torch has no default beside the newest


def own_threads() -> int:
    """Ask torch for the number of threads that the calling thread has.

    torch gives a new thread the number that was set last, wherever: one that is born while another renders a small
    frame would have that one's single thread for good. It gets the usual number instead.
    """
    import torch

    count = torch.get_num_threads()
    if not getattr(_own, "is_known", False):
        _own.is_known = True
        usual = max(list(_usual.values()), default=count)
        if count < usual:
            torch.set_num_threads(usual)
            return usual
    return count


@contextlib.contextmanager
def thread_limit(count: int) -> Generator[None, None, None]:
    """Limit torch and the kernels, within, to `count` threads for what the calling thread asks of them."""
    import torch

    usual, ident = own_threads(), threading.get_ident()
    is_outermost = ident not in _usual
    if is_outermost:
        _usual[ident] = usual
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(usual)
        if is_outermost:
            del _usual[ident]
