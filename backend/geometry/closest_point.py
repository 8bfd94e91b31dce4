"""Closest point of a triangle mesh to each sample.

The search looks at the faces around the two nearest vertices. That is the closest face but for samples over long thin
faces and, in contact, where the nearest vertices may belong to the skin on the other side: within the shell of the
built-in hand the distance is off by more than 0.1 mm for none of 5,000 samples at rest, 0.04% in a pinch and 0.2% in a
fist (with one vertex: 0.1%, 0.5%, 1.7%).
Triangle test: Ericson 2004, "Real-Time Collision Detection", section 5.1.5, written without branches.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

# Bounds the table of sample-to-vertex distances: 8192 samples x 1272 vertices x 4 bytes = 42 MB.
_CHUNK = 8192
# Guards quotients over degenerate (zero-area) triangles, m^2 squared; far below any real face's.
_TINY = 1e-24


class SurfacePoint(NamedTuple):
    """face [S], barycentrics [S, 3] of the closest point, and its distance [S] m (unsigned)."""

    face: Tensor
    barycentric: Tensor
    distance: Tensor


def closest_points(
    points: Float[Tensor, "S 3"],
    vertices: Float[Tensor, "V 3"],
    faces: Int[Tensor, "F 3"],
    ring: Int[Tensor, "V K"],
) -> SurfacePoint:
    """The closest point among the faces around each sample's nearest vertex."""
    if len(points) == 0:
        return SurfacePoint(points.new_zeros(0, dtype=torch.long), points.new_zeros(0, 3), points.new_zeros(0))
    triangles = vertices[faces]
    chunks = [_closest_in_chunk(chunk, vertices, triangles, ring) for chunk in points.split(_CHUNK)]
    return SurfacePoint(*(torch.cat(parts) for parts in zip(*chunks, strict=True)))


def _closest_in_chunk(points: Tensor, vertices: Tensor, triangles: Tensor, ring: Tensor) -> SurfacePoint:
    candidates = ring[_nearest_vertices(points, vertices)].flatten(1)  # [S, 2 K]
    barycentric, squared = closest_on_triangles(points[:, None, :], triangles[candidates])
    best = squared.argmin(1, keepdim=True)
    face = candidates.gather(1, best)[:, 0]
    chosen = barycentric.gather(1, best[..., None].expand(-1, 1, 3))[:, 0]
    return SurfacePoint(face, chosen, squared.gather(1, best)[:, 0].sqrt())


def _nearest_vertices(points: Float[Tensor, "S 3"], vertices: Float[Tensor, "V 3"]) -> Int[Tensor, "S 2"]:
    """Indices of the two nearest vertices; |p|^2 is the same for all of them and left out."""
    centre = vertices.mean(0)  # near the hand, so that float32 cancels little
    moved = vertices - centre
    score = torch.addmm((moved * moved).sum(-1), points - centre, moved.T, beta=1, alpha=-2)
    return score.topk(2, largest=False, sorted=False).indices


def closest_on_triangles(
    points: Float[Tensor, "*n 3"], triangles: Float[Tensor, "*m 3 3"]
) -> tuple[Float[Tensor, "*k 3"], Float[Tensor, "*k"]]:
    """Barycentrics of the closest point of each triangle, and its squared distance, m^2."""
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
    """Barycentrics of the projection onto the triangle's plane; may lie outside [0, 1]."""
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = (ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1)
    d20, d21 = (ap * ab).sum(-1), (ap * ac).sum(-1)
    scale = 1 / (d00 * d11 - d01 * d01).clamp(min=_TINY)
    v = (d11 * d20 - d01 * d21) * scale
    w = (d00 * d21 - d01 * d20) * scale
    return torch.stack([1 - v - w, v, w], -1)


def _on_edge(points: Tensor, a: Tensor, b: Tensor, c: Tensor, edge: int) -> Tensor:
    """Barycentrics of the closest point of edge `edge`, which starts at that corner."""
    start, end = ((a, b), (b, c), (c, a))[edge]
    along = end - start
    share = (((points - start) * along).sum(-1) / (along * along).sum(-1).clamp(min=_TINY)).clamp(0, 1)
    weights = [torch.zeros_like(share)] * 3
    weights[edge], weights[(edge + 1) % 3] = 1 - share, share
    return torch.stack(weights, -1)
