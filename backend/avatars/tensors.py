"""An avatar's weights and surface as its file holds them.

Weights are in half precision, or planes in whole steps of a scale; of a surface, small arrays are as they are, larger
ones deflated. Planes are nine tenths of a relightable avatar: in a byte a value, each channel in steps of its own
largest value, they cost frames no more than some thousandths of a dB.
"""

from __future__ import annotations

import zlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.errors import LiveHandError
from ..surface.base_surface import check_base
from ..surface.stored_surface import ARRAYS, StoredSurface, stored_surface

SCALE = ".scale"
"""After the name of a table in whole steps: what one is worth, for each channel."""
_TABLE, _STEPS = ".table", 127


def stored_weights(weights: dict[str, Tensor], has_byte_planes: bool) -> dict[str, Tensor]:
    """Convert the weights to what a file holds.

    Args:
        weights: by name, on the CPU.
        has_byte_planes: whether tables of planes are stored in a byte a value.
    """
    stored = {}
    for name, values in weights.items():
        if has_byte_planes and name.endswith(_TABLE):
            scale = _scale(values)
            stored[name] = (values / scale).round().to(torch.int8).contiguous()
            stored[name + SCALE] = scale
        else:
            stored[name] = values.half().contiguous()
    return stored


def whole_weights(tensors: dict[str, Tensor], path: Path) -> dict[str, Tensor]:
    """Restore the tensors of a file, its tables in whole steps multiplied by their scales.

    Raises:
        LiveHandError: a scale is missing or does not fit.
    """
    whole = dict(tensors)
    for name in [name for name, values in tensors.items() if values.dtype == torch.int8 and name.endswith(_TABLE)]:
        table, scale = tensors[name], whole.pop(name + SCALE, None)
        if table.ndim != 2 or scale is None or scale.dtype != torch.float32 or scale.shape != table.shape[1:]:
            got = "none" if scale is None else f"{scale.dtype} {list(scale.shape)}"
            raise LiveHandError(
                f"{path}: {name} {list(table.shape)} must have a scale of float32 for each channel, got {got}; "
                "train it again"
            )
        whole[name] = table.float() * scale
    return whole


def _scale(table: Float[Tensor, "T C"]) -> Float[Tensor, " C"]:
    largest = table.float().abs().amax(0)
    return torch.where(largest == 0, torch.ones_like(largest), largest / _STEPS)


PREFIX = "surface/"
PACKED_FROM_BYTES = 4096
_PACKED_KEY = "packed"
_MOST_BYTES = 1 << 29  # unpacked, of all arrays


def surface_tensors(surface: StoredSurface) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Make the description of a surface for a file's header, and the tensors of its own arrays."""
    tensors, packed = {}, {}
    for name, values in surface.arrays.items():
        whole = np.ascontiguousarray(values)
        if whole.nbytes < PACKED_FROM_BYTES:
            tensors[PREFIX + name] = torch.from_numpy(whole.copy())
        else:
            packed[name] = list(whole.shape)
            raw = zlib.compress(whole.tobytes(), 9)
            tensors[PREFIX + name] = torch.frombuffer(bytearray(raw), dtype=torch.uint8)
    return {**surface.description(), _PACKED_KEY: packed}, tensors


def read_surface_tensors(description: Any, tensors: dict[str, Tensor], source: str) -> StoredSurface | None:
    """Read the surface of a file and take its tensors out of the file's; None: the file has none.

    Raises:
        LiveHandError: a part is missing, damaged, of another shape or out of range, or its base is not here.
    """
    own = {name.removeprefix(PREFIX): tensors.pop(name) for name in list(tensors) if name.startswith(PREFIX)}
    if description is None and not own:
        return None
    if not isinstance(description, dict) or not isinstance(packed := description.get(_PACKED_KEY), dict):
        raise LiveHandError(f"{source}: a surface must have a description with {_PACKED_KEY} arrays in the header")
    if not packed.keys() <= own.keys():
        raise LiveHandError(f"{source} must have the surface's arrays {', '.join(packed.keys() - own.keys())}")
    left = _MOST_BYTES
    arrays = {}
    for name, tensor in own.items():
        arrays[name] = _unpacked(name, tensor, packed[name], left, source) if name in packed else tensor.numpy()
        left -= arrays[name].nbytes
    surface = stored_surface(description, arrays, f"{source}: the surface")
    check_base(surface, f"{source}: the surface")
    return surface


def _unpacked(name: str, packed: Tensor, shape: Any, most_bytes: int, source: str) -> np.ndarray:
    if name not in ARRAYS:
        raise LiveHandError(f"{source}: the surface has an array that this version does not know: {name}; update it")
    dtype = np.dtype(ARRAYS[name].dtype)
    is_shape = isinstance(shape, list) and all(type(length) is int and length > 0 for length in shape)
    size = prod(shape) * dtype.itemsize if is_shape else 0
    if not is_shape or packed.dtype != torch.uint8 or size > most_bytes:
        raise LiveHandError(f"{source}: the surface's {name} must be deflated bytes of a shape, got {str(shape)[:80]}")
    unpacking = zlib.decompressobj()
    try:
        raw = unpacking.decompress(packed.numpy().tobytes(), size)
    except zlib.error as error:
        raise LiveHandError(f"{source}: the surface's {name} must be deflated, got damaged bytes ({error})") from error
    if len(raw) != size or unpacking.unconsumed_tail:
        raise LiveHandError(f"{source}: the surface's {name} must be {size} bytes for its shape {shape}, got others")
    return np.frombuffer(bytearray(raw), dtype).reshape(shape)
