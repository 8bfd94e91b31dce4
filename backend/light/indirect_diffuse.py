"""One diffuse bounce of light between parts of the hand, by form factors of surfels.

The surface is taken for discs around its vertices (surfels), whose radiance is given. What a point receives from a disc
is the form factor of a small surface and a disc (Wallace et al. 1989, "A ray tracing algorithm for progressive
radiosity"); occlusion between them is left out. Where skin nearly touches, discs are coarse: the factors' sum is at
most 1. It varies slowly, so that vertices receive it, and what lies on faces has the mean of their corners.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from ..geometry.mesh import PosedMesh, Topology

MOST_SURFELS = 2048
"""Of a mesh of more vertices, as many of them stand for their neighbours; or fewer (`LightQuality`)."""
_LEAST_SQUARED_M = 1e-8
_POINTS_AT_ONCE = 2048
_TINY = 1e-20


class Surfels(NamedTuple):
    """P discs of skin, about some of V vertices.

    Attributes:
        vertices: [V, 3] m, world.
        normals: [V, 3] unit.
        chosen: [P] which are the middles of discs, ascending.
        area_m2: [P].
    """

    vertices: Tensor
    normals: Tensor
    chosen: Tensor
    area_m2: Tensor

    @classmethod
    def of(cls, mesh: PosedMesh, topology: Topology, most: int = MOST_SURFELS) -> Surfels:
        """Make at most so many discs, each a third of the faces around a vertex; together as large as the hand."""
        a, b, c = mesh.vertices[topology.faces].unbind(1)
        thirds = torch.linalg.cross(b - a, c - a).norm(dim=-1, keepdim=True).expand(-1, 3) / 6
        area_m2 = thirds.new_zeros(len(mesh.vertices)).index_add(0, topology.faces.flatten(), thirds.flatten())
        chosen = surfel_vertices(len(mesh.vertices), most).to(a.device)
        share = area_m2.sum() / area_m2[chosen].sum()
        return cls(mesh.vertices, mesh.normals, chosen, share * area_m2[chosen])

    @property
    def position(self) -> Float[Tensor, "P 3"]:
        """Of the discs, m, world."""
        return self._of_chosen(self.vertices)

    @property
    def normal(self) -> Float[Tensor, "P 3"]:
        """Of the discs, unit."""
        return self._of_chosen(self.normals)

    def _of_chosen(self, values: Float[Tensor, "V 3"]) -> Float[Tensor, "P 3"]:
        """Select the values of the surfels; they are in order: as many as there are vertices are all of them."""
        return values if len(self.chosen) == len(values) else values[self.chosen]


def surfel_vertices(count: int, most: int = MOST_SURFELS) -> Int[Tensor, " P"]:
    """Choose which of a hand's vertices are surfels."""
    return torch.linspace(0, count - 1, min(count, most)).round().long()


class MeshPoints(NamedTuple):
    """Where R points lie on a mesh.

    Attributes:
        vertex: [R, 3] corners of their faces.
        weight: [R, 3] of the corners; all 0 for points beside the mesh.
    """

    vertex: Tensor
    weight: Tensor

    @classmethod
    def of(
        cls, mesh: PosedMesh, faces: Int[Tensor, "F 3"], face: Int[Tensor, " R"], position: Float[Tensor, "R 3"]
    ) -> MeshPoints:
        """Locate points near faces on the mesh; face -1 is none."""
        vertex = faces[face.clamp(min=0).long()]
        a, b, c = mesh.vertices[vertex].unbind(1)
        normal = torch.linalg.cross(b - a, c - a)
        edges = ((b, c), (c, a), (a, b))
        parts = [
            (torch.linalg.cross(end - start, position - start) * normal).sum(-1).clamp(min=0) for start, end in edges
        ]
        weight = torch.stack(parts, -1) * (face >= 0)[:, None]
        return cls(vertex, weight / weight.sum(-1, keepdim=True).clamp(min=_TINY))

    @property
    def is_beside(self) -> Tensor:
        """[R] which points lie beside the mesh."""
        return self.weight.sum(-1) == 0

    def corners(self, count: int) -> Int[Tensor, " C"]:
        """Return which of a mesh's vertices are corners of faces that points lie on, ascending."""
        is_corner = torch.zeros(count, dtype=torch.bool, device=self.vertex.device)
        is_corner[self.vertex.flatten()] = True
        return is_corner.nonzero()[:, 0]

    def blend(self, values: Float[Tensor, "V C"]) -> Float[Tensor, "R C"]:
        """Interpolate values of the vertices at the points; 0 beside the mesh."""
        return embedding_bag(self.vertex, values, mode="sum", per_sample_weights=self.weight)


MeshPointsOf = Callable[[PosedMesh, Tensor, Tensor, Tensor], MeshPoints]
"""`MeshPoints.of`, or what equals it."""
IndirectDiffuse = Callable[[Tensor, Tensor, Surfels, Tensor], Tensor]


def indirect_diffuse(
    position: Float[Tensor, "R 3"], normal: Float[Tensor, "R 3"], surfels: Surfels, emitted: Float[Tensor, "P 3"]
) -> Float[Tensor, "R 3"]:
    """Compute the indirect diffuse light of points, as the radiance of a white diffuse surface there.

    Args:
        position: m, world.
        normal: unit.
        surfels: the skin.
        emitted: radiance of each surfel.
    """
    at_once = zip(position.split(_POINTS_AT_ONCE), normal.split(_POINTS_AT_ONCE), strict=True)
    return torch.cat([_indirect_diffuse(*some, surfels, emitted) for some in at_once])


def _indirect_diffuse(position: Tensor, normal: Tensor, surfels: Surfels, emitted: Tensor) -> Tensor:
    offset = surfels.position - position[:, None]
    squared = (offset * offset).sum(-1)
    here = (offset * normal[:, None]).sum(-1).clamp(min=0)
    there = -(offset * surfels.normal).sum(-1).clamp(max=0)
    factors = here * there * surfels.area_m2 / (squared.clamp(min=_LEAST_SQUARED_M) * (pi * squared + surfels.area_m2))
    return factors @ emitted / factors.sum(1, keepdim=True).clamp(min=1)


def indirect_diffuse_on_mesh(
    hit_points: MeshPoints,
    position: Float[Tensor, "R 3"],
    normal: Float[Tensor, "R 3"],
    surfels: Surfels,
    emitted: Float[Tensor, "P 3"],
    indirect: IndirectDiffuse = indirect_diffuse,
) -> Float[Tensor, "R 3"]:
    """Interpolate the indirect diffuse light of points between the mesh's vertices; points beside it as they are.

    Args:
        hit_points: of the points.
        position: m, world.
        normal: unit.
        surfels: the skin.
        emitted: radiance of each surfel.
        indirect: as `indirect_diffuse`.
    """
    corners = hit_points.corners(len(surfels.vertices))
    at_corners = indirect(surfels.vertices[corners], surfels.normals[corners], surfels, emitted)
    received = hit_points.blend(torch.zeros_like(surfels.vertices).index_put((corners,), at_corners))
    beside = hit_points.is_beside.nonzero()[:, 0]
    return received.index_put((beside,), indirect(position[beside], normal[beside], surfels, emitted))
