"""Memory of the process, now and at its peak.

On the CPU this is the process's resident memory, which includes what earlier configurations left in the allocator: a
peak is an upper bound. On CUDA it is the memory that torch has allocated.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import torch

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")
_RESET_PEAK = "5"  # see proc(5)


def memory_mb(device: torch.device) -> float | None:
    """Read the memory in use now; None where the system does not report it."""
    if device.type == "cuda":
        return torch.cuda.memory_allocated(device) / 1e6
    return _status_mb("VmRSS")


def reset_peak(device: torch.device) -> None:
    """Forget the peak so far."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return
    with suppress(OSError):
        _CLEAR.write_text(_RESET_PEAK)


def peak_mb(device: torch.device) -> float | None:
    """Read the peak since the last reset; None where the system does not report it."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e6
    return _status_mb("VmHWM")


def _status_mb(name: str) -> float | None:
    """Read an entry of /proc/self/status, which only Linux has."""
    if not _STATUS.is_file():
        return None
    lines = [line for line in _STATUS.read_text().splitlines() if line.startswith(f"{name}:")]
    return int(lines[0].split()[1]) * 1024 / 1e6 if lines else None
