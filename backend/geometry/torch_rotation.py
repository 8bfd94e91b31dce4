"""Rotations on torch tensors, any leading batch axes. Axis-angle in rad; matrices act on column vectors."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

# Below this squared angle (rad^2) the series replace sin(x)/x and (1-cos(x))/x^2, whose gradients divide by zero at 0.
_SMALL_ANGLE_SQUARED = 1e-6


def axis_angle_to_matrix(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Apply Rodrigues' formula: R = I + sin(a)/a K + (1 - cos(a))/a^2 K^2, with finite gradients at 0."""
    squared = (axis_angle * axis_angle).sum(-1)[..., None, None]
    is_small = squared < _SMALL_ANGLE_SQUARED
    safe = torch.where(is_small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    sine = torch.where(is_small, 1 - squared / 6, angle.sin() / angle)
    cosine = torch.where(is_small, 0.5 - squared / 24, (1 - angle.cos()) / safe)
    cross = cross_matrix(axis_angle)
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + sine * cross + cosine * (cross @ cross)


def cross_matrix(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Build K with K @ x = vector x x."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return torch.stack(rows, -1).reshape(*vector.shape[:-1], 3, 3)
