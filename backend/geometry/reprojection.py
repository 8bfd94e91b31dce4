"""Lays points that stay where they are on a surface that moves, with gradients to its vertices.

Tracing (`tracking`) finds which face each sample of a ray lies on. That costs as much as a training step and has no
gradient. While the surface moves by less than a face's width, each sample may keep its face: where over that face it
lies, and how high, follow smoothly from the vertices.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .closest_point import closest_on_triangles
from .mesh import PosedMesh, Topology
from .uvh import SurfaceSamples, interpolate

# Nearer to the surface than this, the offset from it has no direction of its own and the surface's normal serves, m.
_MIN_OFFSET_M = 1e-6


def reproject(
    points: Float[Tensor, "S 3"], face: Int[Tensor, " S"], topology: Topology, mesh: PosedMesh
) -> SurfaceSamples:
    """The points over the closest points of the faces they keep; `height_m` in the template's metres.

    The height's derivative is the one of the distance to a surface point that stays where it is on its face: to first
    order the closest point's own sliding does not change the distance.
    """
    barycentric, _ = closest_on_triangles(points, mesh.vertices[topology.faces[face]])
    held = SurfaceSamples(face, barycentric.detach(), barycentric[:, 0].detach())
    offset = points - interpolate(mesh.vertices, topology, held)
    outward = _outward(offset.detach(), interpolate(mesh.normals.detach(), topology, held))
    return SurfaceSamples(face, barycentric, (offset * outward).sum(-1) / mesh.scale)


def _outward(offset: Float[Tensor, "S 3"], normal: Float[Tensor, "S 3"]) -> Float[Tensor, "S 3"]:
    """Unit offsets, turned to the normal's side; the unit normal where there is no offset to speak of."""
    length = offset.norm(dim=-1, keepdim=True)
    sign = torch.where((offset * normal).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    unit_normal = torch.nn.functional.normalize(normal, dim=-1)
    return torch.where(length > _MIN_OFFSET_M, sign * offset / length.clamp(min=_MIN_OFFSET_M), unit_normal)
