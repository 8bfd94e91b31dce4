"""Where rays meet an avatar's surface: light falls on its normals, and on the part of the hand that it shows."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..field.rays import CameraTensors, project
from .detail_mesh import DetailMesh, barycentric, blend_corners, first_fronts

SAME_PART = 0.5  # of the depth by which two surfaces differ; held-out views like 1 and 0.25 less


class RayHits(NamedTuple):
    """R rays.

    Attributes:
        depth: [R] m; infinite where a ray misses the surface.
        normal: [R, 3] of the surface, unit, world; zeros where a ray misses it.
    """

    depth: Tensor
    normal: Tensor

    def is_of_other_part(self, depth: Float[Tensor, " R"], edge_m: Float[Tensor, ""]) -> Bool[Tensor, " R"]:
        """Return whether a surface at this depth is another part of the hand than the one that the rays meet.

        A mesh of few faces ends beside the detail surface, and there shows what lies behind or beside it.

        Args:
            depth: m.
            edge_m: as in `SurfaceDepth`.
        """
        return self.depth.isfinite() & ((self.depth - depth).abs() > SAME_PART * edge_m)

    def positions(
        self, origins: Float[Tensor, "R 3"], directions: Float[Tensor, "R 3"], beside: Float[Tensor, "R 3"]
    ) -> Float[Tensor, "R 3"]:
        """Compute where the rays meet the surface, m, world.

        Args:
            origins: of the rays, of depth 0, m.
            directions: of depth 1.
            beside: taken for rays that miss it.
        """
        meets = self.depth.isfinite()[:, None]
        return torch.where(meets, origins + self.depth[:, None] * directions, beside)


def ray_hits(mesh: DetailMesh, camera: CameraTensors, pixel: Int[Tensor, " R"]) -> RayHits:
    """Find where rays through the centres of pixels first meet the front of a posed surface."""
    fronts = first_fronts(mesh, *project(camera, mesh.vertices), camera)
    meets = (fronts.face[pixel] >= 0).nonzero()[:, 0]
    face = fronts.face[pixel[meets]].long()
    normal = blend_corners(mesh.normals[mesh.faces[face]], barycentric(mesh, camera, face, pixel[meets]))
    normals = mesh.normals.new_zeros(len(pixel), 3).index_put((meets,), normalize(normal, dim=-1))
    return RayHits(fronts.depth[pixel], normals)
