"""What torch's threads do while they wait for work."""

from __future__ import annotations

import os

# Turns of a waiting loop, about a tenth of a millisecond; the library's own 300,000 are 8 ms and more.
_GNU_SPINS = "10000"
_LLVM_BLOCK_MS = "1"


def spin_briefly() -> None:
    """Make waiting threads give up their core soon. Call it before torch is imported; what the user has set stays.

    Between two of torch's operations its threads would otherwise go on turning on cores that the kernels need: a frame
    on two cores takes a fifth longer.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", _GNU_SPINS)
    os.environ.setdefault("KMP_BLOCKTIME", _LLVM_BLOCK_MS)
