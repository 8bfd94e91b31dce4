"""Closest point of triangles to points.

Triangle test: Ericson 2004, "Real-Time Collision Detection", section 5.1.5, written without branches.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from .tolerances import MIN_DETERMINANT


def closest_on_triangles(
    points: Float[Tensor, "*n 3"], triangles: Float[Tensor, "*m 3 3"]
) -> tuple[Float[Tensor, "*k 3"], Float[Tensor, "*k"]]:
    """Compute barycentrics of the closest point of each triangle, and its squared distance, m^2."""
    a, b, c = triangles.unbind(-2)
    inside = _plane_barycentric(points, a, b, c)
    best = torch.stack([inside, *(_on_edge(points, a, b, c, edge) for edge in range(3))], -2)  # [*k, 4, 3]
    offsets = torch.einsum("...ek,...kc->...ec", best, triangles.expand(*best.shape[:-2], 3, 3)) - points[..., None, :]
    squared = (offsets * offsets).sum(-1)
    is_outside = (inside < 0).any(-1)
    squared = torch.cat([squared[..., :1].masked_fill(is_outside[..., None], torch.inf), squared[..., 1:]], -1)
    squared, choice = squared.min(-1)
    index = choice[..., None, None].expand(*choice.shape, 1, 3)
    return best.gather(-2, index)[..., 0, :], squared


def _plane_barycentric(points: Tensor, a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """Compute barycentrics of the projection onto the triangle's plane; may lie outside [0, 1]."""
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = (ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1)
    d20, d21 = (ap * ab).sum(-1), (ap * ac).sum(-1)
    scale = 1 / (d00 * d11 - d01 * d01).clamp(min=MIN_DETERMINANT)
    v = (d11 * d20 - d01 * d21) * scale
    w = (d00 * d21 - d01 * d20) * scale
    return torch.stack([1 - v - w, v, w], -1)


def _on_edge(points: Tensor, a: Tensor, b: Tensor, c: Tensor, edge: int) -> Tensor:
    """Compute barycentrics of the closest point of edge `edge`, which starts at that corner."""
    start, end = ((a, b), (b, c), (c, a))[edge]
    along = end - start
    share = (((points - start) * along).sum(-1) / (along * along).sum(-1).clamp(min=MIN_DETERMINANT)).clamp(0, 1)
    weights = [torch.zeros_like(share)] * 3
    weights[edge], weights[(edge + 1) % 3] = 1 - share, share
    return torch.stack(weights, -1)
