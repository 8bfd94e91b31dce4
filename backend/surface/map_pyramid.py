"""A pyramid of maps over the atlas in one table: each level half as wide as the one before, sampled between texels."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

LEVELS = 6


def pyramid_levels(resolution: int) -> list[tuple[int, int]]:
    """Return (first row of the table, resolution) of each level.

    Args:
        resolution: of the finest.
    """
    sizes = [resolution >> level for level in range(LEVELS)]
    return [(sum(size**2 for size in sizes[:level]), sizes[level]) for level in range(LEVELS)]


def trilinear(
    table: Int[Tensor, "T C"], resolution: int, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]
) -> Float[Tensor, "P C"]:
    """Sample a pyramid, in stored steps.

    Args:
        table: texels of all levels, rows of the finest first, the smallest v first.
        resolution: of the finest level.
        uv: coordinates in the atlas.
        level: 0 the finest; between two, their mean by its share.
    """
    fine = level.clamp(0, LEVELS - 1).floor().long()
    share = (level.clamp(0, LEVELS - 1) - fine)[:, None]
    coarse = (fine + 1).clamp(max=LEVELS - 1)
    starts = torch.tensor(pyramid_levels(resolution), device=uv.device)
    return _bilinear(table, starts[fine], uv) * (1 - share) + _bilinear(table, starts[coarse], uv) * share


def _bilinear(table: Tensor, start_and_size: Int[Tensor, "P 2"], uv: Tensor) -> Float[Tensor, "P C"]:
    start, size = start_and_size.unbind(1)
    place = (uv * size[:, None] - 0.5).clamp(min=0).minimum(size[:, None] - 1.0)
    first = place.floor().minimum(size[:, None] - 2.0)
    (fu, fv), (u, v) = (place - first).unbind(1), first.long().unbind(1)
    corner = start + v * size + u
    rows = (corner, corner + 1, corner + size, corner + size + 1)
    weights = ((1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv)
    parts = [table[row].float() * weight[:, None] for row, weight in zip(rows, weights, strict=True)]
    return parts[0] + parts[1] + parts[2] + parts[3]
