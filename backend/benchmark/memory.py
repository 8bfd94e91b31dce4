"""Peak memory over the loaded model.

On the CPU it is the process's resident memory: the highest since the last reset, less what there was when the models
had been loaded. What other configurations left behind in the allocator counts, so the figure is an upper bound. On
CUDA it is what torch has allocated.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import torch

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")
_RESET_PEAK = "5"  # see proc(5)


def memory_mb(device: torch.device) -> float | None:
    """In use now; None where the system does not say."""
    if device.type == "cuda":
        return torch.cuda.memory_allocated(device) / 1e6
    return _status_mb("VmRSS")


def reset_peak(device: torch.device) -> None:
    """Forget the highest so far."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return
    with suppress(OSError):
        _CLEAR.write_text(_RESET_PEAK)


def peak_mb(device: torch.device) -> float | None:
    """The highest since the last reset; None where the system does not say."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e6
    return _status_mb("VmHWM")


def _status_mb(name: str) -> float | None:
    """One of the process's own figures, as Linux keeps them."""
    if not _STATUS.is_file():
        return None
    lines = [line for line in _STATUS.read_text().splitlines() if line.startswith(f"{name}:")]
    return int(lines[0].split()[1]) * 1024 / 1e6 if lines else None
