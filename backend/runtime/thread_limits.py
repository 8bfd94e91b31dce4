"""What torch must be told before it is imported, and limits on its threads."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator

# Iterations of a waiting loop, about 0.1 ms; the library's default of 300,000 takes 8 ms and more.
_GNU_SPINS = "10000"
_LLVM_BLOCK_MS = "1"


def limit_spinning() -> None:
    """Make waiting threads yield their core soon. Call it before torch is imported; the user's own settings win.

    Otherwise torch's threads keep spinning between operations, on cores that the kernels need: a frame on two cores
    takes a fifth longer.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", _GNU_SPINS)
    os.environ.setdefault("KMP_BLOCKTIME", _LLVM_BLOCK_MS)


def allow_cpu_for_mps() -> None:
    """Let the CPU do what torch lacks for a Mac's GPU. Call it before torch is imported."""
    os.environ.setdefault("PYTORCH_ENABLE_MPS_FALLBACK", "1")


@contextlib.contextmanager
def thread_limit(count: int) -> Generator[None, None, None]:
    """Inside the context, torch and the kernels use `count` threads; nothing else may use torch meanwhile."""
    import torch

    usual = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(usual)
