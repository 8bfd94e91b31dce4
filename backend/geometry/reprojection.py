"""Projects fixed points onto a moving surface, with gradients to its vertices.

`surface_tracking` finds the face below each sample of a ray. It costs as much as a training step and has no gradient.
While the surface moves by less than the width of a face, each sample may keep its face: its barycentric coordinates
and its height then follow smoothly from the vertices.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .closest_point import closest_on_triangles
from .mesh import PosedMesh, Topology
from .uvh import SurfaceSamples, interpolate

# Below this distance, m, the offset has no reliable direction, and the surface normal replaces it.
_MIN_OFFSET_M = 1e-6


def reproject(
    points: Float[Tensor, "S 3"], face: Int[Tensor, " S"], topology: Topology, mesh: PosedMesh
) -> SurfaceSamples:
    """Project points onto given faces; `height_m` is in the template's metres.

    The height's derivative is that of the distance to a point fixed on the face: to first order, the closest point's
    motion along the face does not change the distance.
    """
    barycentric, _ = closest_on_triangles(points, mesh.vertices[topology.faces[face]])
    held = SurfaceSamples(face, barycentric.detach(), barycentric[:, 0].detach())
    offset = points - interpolate(mesh.vertices, topology, held)
    outward = _outward(offset.detach(), interpolate(mesh.normals.detach(), topology, held))
    return SurfaceSamples(face, barycentric, (offset * outward).sum(-1) / mesh.scale)


def _outward(offset: Float[Tensor, "S 3"], normal: Float[Tensor, "S 3"]) -> Float[Tensor, "S 3"]:
    """Orient unit offsets along the normal; the unit normal where the offset is negligible."""
    length = offset.norm(dim=-1, keepdim=True)
    sign = torch.where((offset * normal).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    unit_normal = torch.nn.functional.normalize(normal, dim=-1)
    return torch.where(length > _MIN_OFFSET_M, sign * offset / length.clamp(min=_MIN_OFFSET_M), unit_normal)
