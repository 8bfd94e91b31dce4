"""Memory that was asked for and is not there, as one sentence with the gigabytes."""

from __future__ import annotations

import re

_GIB = 1 << 30
_UNITS = {
    "bytes": 1,
    "B": 1,
    "KiB": 1 << 10,
    "MiB": 1 << 20,
    "GiB": _GIB,
    "TiB": 1 << 40,
    "PiB": 1 << 50,
    "EiB": 1 << 60,
}
# numpy: Unable to allocate 4.00 GiB for an array with shape (...). torch: you tried to allocate 4294967296 bytes.
# CUDA: Tried to allocate 2.00 GiB.
_ASKED = re.compile(rf"allocate (\d+(?:\.\d+)?) ({'|'.join(_UNITS)})")
_TORCH = ("can't allocate memory", "out of memory", "not enough memory")
_REMEDY = "make the image smaller or render fewer at once, or close other programs"


def memory_message(error: BaseException) -> str | None:
    """Explain an error that means that memory is short; None: it means something else."""
    text = str(error)
    is_torch = isinstance(error, RuntimeError) and any(part in text for part in _TORCH)
    if not (isinstance(error, MemoryError) or is_torch):
        return None
    asked = _ASKED.search(text)
    place = "the GPU's memory" if "CUDA" in text or "MPS" in text else "memory"
    if asked is None:
        return f"more {place} must be free than there is; {_REMEDY}"
    gigabytes = float(asked[1]) * _UNITS[asked[2]] / _GIB
    return f"{gigabytes:.3g} GB of {place} more must be free, there is less; {_REMEDY}"
