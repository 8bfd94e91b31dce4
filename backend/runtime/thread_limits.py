"""How many threads torch works with, and what they do while they wait for work."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

# Turns of a waiting loop, about a tenth of a millisecond; the library's own 300,000 are 8 ms and more.
_GNU_SPINS = "10000"
_LLVM_BLOCK_MS = "1"


def limit_spinning() -> None:
    """Make waiting threads give up their core soon. Call it before torch is imported; what the user has set stays.

    Between two of torch's operations its threads would otherwise go on turning on cores that the kernels need: a frame
    on two cores takes a fifth longer.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", _GNU_SPINS)
    os.environ.setdefault("KMP_BLOCKTIME", _LLVM_BLOCK_MS)


@contextlib.contextmanager
def thread_limit(count: int) -> Iterator[None]:
    """Within, torch and the kernels use so many threads. Everything else that uses torch has to wait meanwhile."""
    import torch

    usual = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(usual)
