"""The weights of an avatar's networks as its file holds them: in half precision, or planes in whole steps of a scale.

Planes are nine tenths of a relightable avatar. In a byte a value, each channel in steps of its own largest value, they
cost frames no more than some thousandths of a dB; networks compute with them as with any others.
"""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from ..records.errors import LiveHandError

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
