"""Projects any points in space onto a posed mesh, where no ray leads to them."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.uvh import SurfaceSamples
from .surface_tracking import track

_TRACKED_M = 0.03  # samples farther from all vertices keep the nearest one's place: their height is clipped anyway


class NearSkin:
    """Projects any points onto a posed mesh.

    Args:
        mesh: of the pose.
        topology: of the hand.
    """

    def __init__(self, mesh: PosedMesh, topology: Topology):
        self._mesh, self._topology = mesh, topology
        self._tree = KDTree(mesh.vertices.cpu().numpy())
        faces = topology.faces
        of_corner = torch.arange(len(faces), device=faces.device).repeat_interleave(3)
        of_vertex = torch.zeros(len(mesh.vertices), dtype=torch.long, device=faces.device)
        # The first face of each: an assignment would take any one, and another every time.
        self._face_of_vertex = of_vertex.scatter_reduce(0, faces.flatten(), of_corner, "amin", include_self=False)

    def at(self, points: Float[Tensor, "S 3"]) -> SurfaceSamples:
        """Find the surface point below each; heights in the template's metres, far ones only roughly."""
        distance, vertex, height = self._nearest_vertex(points)
        face = self._face_of_vertex[vertex]
        barycentric = (self._topology.faces[face] == vertex[:, None]).float()
        (near,) = torch.where(distance < _TRACKED_M * float(self._mesh.scale))
        found = self._tracked(points[near], face[near])
        face = face.index_put((near,), found.face)
        barycentric = barycentric.index_put((near,), found.barycentric)
        height = height.index_put((near,), found.height_m)
        return SurfaceSamples(face, barycentric, height / self._mesh.scale)

    def roughly(self, points: Float[Tensor, "S 3"], near_m: float) -> tuple[Int[Tensor, " N"], Float[Tensor, " S"]]:
        """Tell which points are within a distance, m, of a vertex, and all heights, m, from the nearest vertices."""
        distance, _, height = self._nearest_vertex(points)
        return torch.where(distance < near_m)[0], height

    def _nearest_vertex(self, points: Float[Tensor, "S 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """Return distance [S], m, and index [S] of the vertex nearest to each point, and the height [S] over it, m."""
        distance, vertex = self._tree.query(points.detach().cpu().numpy())
        distance, vertex = (torch.as_tensor(values, device=points.device) for values in (distance, vertex))
        offset = points - self._mesh.vertices[vertex]
        outside = torch.where((offset * self._mesh.normals[vertex]).sum(-1) < 0, -1.0, 1.0)
        return distance, vertex, outside * distance.float()

    def _tracked(self, points: Float[Tensor, "P 3"], face: Int[Tensor, " P"]) -> SurfaceSamples:
        is_open = torch.ones(len(points), 1, 1, dtype=torch.bool, device=points.device)
        return track(points[:, None], face[:, None], is_open, self._topology, self._mesh)
