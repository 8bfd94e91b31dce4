"""One more subdivision of a posed detail mesh, for images whose pixels are smaller than its chords are flat.

Vertices stay where they are. On each edge, one more lies on the cubic that meets both ends at right angles to their
normals (PN triangles: Vlachos et al. 2001, "Curved PN triangles"), with the mean of their values and of their normals:
so the outline is round, and nothing else differs from what faces show by themselves. Shadows are cast by the mesh.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from ..field.rays import HandInView
from ..geometry.loop import split_corners, split_faces
from .detail_mesh import DetailMesh, DetailTemplate
from .edge_antialiasing import SurfaceBones

SAGITTA_M = 0.00006
"""Template metres: 19 of 20 edges of the surface, open or in a fist, are nearer to the middles of their arcs."""
FLAT_UP_TO_PX, ROUND_FROM_PX = 0.2, 0.3
"""Sagittas in the image up to which edges stay straight, and from which on they are arcs."""


class CurvedFaces(NamedTuple):
    """The M faces of a detail mesh of N vertices, each split in four.

    Attributes:
        edges: [E, 2] of the mesh; a vertex lies on each, after the N.
        faces: [4 M, 3].
        corner_uv: [4 M, 3, 2].
        bones: that the faces follow.
    """

    edges: Tensor
    faces: Tensor
    corner_uv: Tensor
    bones: SurfaceBones

    @classmethod
    def of(cls, template: DetailTemplate) -> CurvedFaces:
        """Split the faces of all poses of a surface."""
        split = split_faces(template.faces.numpy(force=True), len(template.offset_m))
        edges, faces = (torch.as_tensor(indices).to(template.faces) for indices in (split.edges, split.faces))
        corner_uv = torch.as_tensor(split_corners(template.corner_uv.numpy(force=True))).to(template.corner_uv)
        return cls(edges, faces, corner_uv, template.bones._replace(of_face=template.bones.of_face.repeat(4)))

    def curved(self, mesh: DetailMesh, roundness: float = 1.0) -> DetailMesh:
        """Subdivide the mesh; its own faces become the coarse ones.

        Args:
            mesh: posed.
            roundness: of its edges, 0 straight to 1.
        """
        first, second = self.edges.unbind(1)
        normals, along = mesh.normals, mesh.vertices[second] - mesh.vertices[first]
        bow = _along_normal(along, normals[second]) - _along_normal(along, normals[first])
        middles = 0.5 * (mesh.vertices[first] + mesh.vertices[second]) + 0.125 * roundness * bow
        return mesh._replace(
            vertices=torch.cat([mesh.vertices, middles]),
            normals=torch.cat([normals, normalize(normals[first] + normals[second], dim=-1)]),
            faces=self.faces,
            corner_uv=self.corner_uv,
            flex=self.with_middles(mesh.flex),
            bones=self.bones,
            coarse_faces=mesh.faces,
        )

    def with_middles(self, values: Float[Tensor, " N"]) -> Float[Tensor, " K"]:
        """Append the means of edges' ends."""
        return torch.cat([values, values[self.edges].mean(1)])


def _along_normal(vectors: Float[Tensor, "E 3"], normals: Float[Tensor, "E 3"]) -> Float[Tensor, "E 3"]:
    return (vectors * normals).sum(-1, keepdim=True) * normals


def roundness_in(hand: HandInView) -> float:
    """Compute how round a surface's edges must be in the image, of twice the size of the rays': it grows smoothly.

    Edges of 0 are to be shown as they are.
    """
    mesh, camera = hand.mesh, hand.camera
    nearest_m = camera.divisor(mesh.vertices @ camera.world2cam[2, :3] + camera.world2cam[2, 3]).min()
    if nearest_m <= 0:
        return 1.0
    sagitta_px = float(2 * SAGITTA_M * mesh.scale * camera.focal_px / nearest_m)
    return min(max((sagitta_px - FLAT_UP_TO_PX) / (ROUND_FROM_PX - FLAT_UP_TO_PX), 0.0), 1.0)
