"""Normals of a known surface at rays on the CPU: as `nerf.ray_normals`, by the kernel."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..nerf.fine_mesh import FineMesh, PixelSurface
from ..nerf.rays import CameraTensors, project
from .arrays import as_arrays
from .kernels.compiled import in_parallel
from .kernels.ray_normals import fill_normals
from .kernels.records import ProjectedMesh


def ray_normals(
    mesh: FineMesh,
    seen: PixelSurface,
    camera: CameraTensors,
    pixel: Int[Tensor, " R"],
    position: Float[Tensor, "R 3"],
    edge_m: Float[Tensor, ""],
) -> Float[Tensor, "R 3"]:
    """As `nerf.ray_normals.ray_normals`."""
    depth = position @ camera.world2cam[2, :3] + camera.world2cam[2, 3]
    projected = ProjectedMesh(*as_arrays(*project(camera, mesh.vertices), mesh.faces))
    at, of_rays, face, of_faces, of_vertices = as_arrays(pixel, depth, seen.face, seen.depth, mesh.normals)
    image, found = (face, of_faces, camera.size_px[0]), torch.empty_like(position)
    edge, out = np.float32(edge_m), found.numpy()
    in_parallel(
        lambda first, last: fill_normals(projected, of_vertices, image, at, of_rays, edge, first, last, out),
        len(pixel),
        torch.get_num_threads(),
    )
    return found
