"""CIE Lab (1976) under D65 of linear Rec. 709: lightness L* from 0 to 100, a* and b* (CIE 15)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

_RGB_TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
_LINEAR_BELOW = 6 / 29


def lab(rgb_linear: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Convert to L*, a* and b*."""
    matrix = rgb_linear.new_tensor(_RGB_TO_XYZ)
    x, y, z = _curve(rgb_linear @ (matrix / matrix.sum(1, keepdim=True)).T).unbind(-1)
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)


def lightness(rgb_linear: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Convert to L* alone."""
    return 116 * _curve(rgb_linear @ rgb_linear.new_tensor(_RGB_TO_XYZ[1])) - 16


def _curve(share: Float[Tensor, "*any"]) -> Float[Tensor, "*any"]:
    """Take the cube root of a share of white's X, Y or Z; of dark ones, its tangent."""
    root = share.clamp(min=_LINEAR_BELOW**3) ** (1 / 3)
    return torch.where(share > _LINEAR_BELOW**3, root, share / (3 * _LINEAR_BELOW**2) + 4 / 29)
