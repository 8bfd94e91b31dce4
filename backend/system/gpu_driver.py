"""What NVIDIA's driver says of itself, without Warp or torch: its library is loaded, and no GPU is started."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from typing import NamedTuple

_LIBRARIES = {"win32": "nvcuda.dll", "linux": "libcuda.so.1"}
OLDEST_CUDA = 13
"""The major version that a driver must support for Warp of `packages.GPU`."""


class CudaVersion(NamedTuple):
    """The newest CUDA that a driver supports."""

    major: int
    minor: int


@cache
def cuda_of_driver() -> CudaVersion | None:
    """Return the CUDA of this system's NVIDIA driver; None: there is none, as on a Mac. It is asked once a process."""
    name = _LIBRARIES.get(sys.platform)
    if name is None:
        return None
    version = ctypes.c_int(0)
    try:
        failed = ctypes.CDLL(name).cuDriverGetVersion(ctypes.byref(version))
    except (OSError, AttributeError):  # no driver, or another library of this name
        return None
    number = version.value  # 1000 major + 10 minor
    return None if failed or number <= 0 else CudaVersion(number // 1000, number % 1000 // 10)


def driver_fault(driver: CudaVersion) -> str:
    """Say what must be done before Warp can use a driver; empty: nothing.

    Any driver of the oldest major version will do, also one of an earlier minor version than Warp was built with.
    """
    return f"update the NVIDIA driver (CUDA {OLDEST_CUDA})" if driver.major < OLDEST_CUDA else ""
