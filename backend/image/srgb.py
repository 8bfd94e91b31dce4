"""sRGB encoding and its inverse (IEC 61966-2-1, the piecewise curve), on torch tensors in [0, 1]."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def srgb_to_linear(encoded: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """Decode sRGB to linear light."""
    return torch.where(encoded <= 0.04045, encoded / 12.92, ((encoded.clamp(min=0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """Encode linear light as sRGB."""
    curved = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, linear * 12.92, curved)
