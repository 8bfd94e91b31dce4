"""The sphere of directions laid out on a square (octahedral map, Praun and Hoppe 2003)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def on_square(towards: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n"]]:
    """(u, v) in [-1, 1] of directions of any length but 0."""
    x, y, z = (towards / towards.abs().sum(-1, keepdim=True)).unbind(-1)
    below = z < 0
    return torch.where(below, (1 - y.abs()).copysign(x), x), torch.where(below, (1 - x.abs()).copysign(y), y)


def from_square(u: Float[Tensor, "*n"], v: Float[Tensor, "*n"]) -> Float[Tensor, "*n 3"]:
    """Unit directions; a point up to 1 beyond an edge is where the sphere goes on there, on the same square."""
    u, v = torch.where(u.abs() > 1, (2 - u.abs()).copysign(u), u), torch.where(u.abs() > 1, -v, v)
    u, v = torch.where(v.abs() > 1, -u, u), torch.where(v.abs() > 1, (2 - v.abs()).copysign(v), v)
    z = 1 - u.abs() - v.abs()
    below = z < 0
    x, y = torch.where(below, (1 - v.abs()).copysign(u), u), torch.where(below, (1 - u.abs()).copysign(v), v)
    return torch.nn.functional.normalize(torch.stack([x, y, z], -1), dim=-1)
