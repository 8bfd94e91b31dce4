"""Where rays meet a known surface on the CPU: as `surface.ray_hits`, by the kernels."""

from __future__ import annotations

import torch
from jaxtyping import Int
from torch import Tensor

from ...field.rays import CameraTensors
from ...surface.fine_mesh import FineMesh
from ...surface.ray_hits import RayHits
from ..kernels.ray_hits import fill_normals
from .arrays import as_arrays
from .fronts import find_fronts
from .projection import projected_mesh
from .threads import in_parallel


def ray_hits(mesh: FineMesh, camera: CameraTensors, pixel: Int[Tensor, " R"]) -> RayHits:
    """As `surface.ray_hits.ray_hits`."""
    projected = projected_mesh(camera, mesh.vertices, mesh.faces)
    fronts = find_fronts(projected, camera.size_px)
    at, of_vertices = as_arrays(pixel, mesh.normals)
    normal = torch.empty(len(pixel), 3)
    face, width, out = fronts.face[at], camera.size_px[0], normal.numpy()
    in_parallel(lambda first, last: fill_normals(projected, of_vertices, face, at, width, first, last, out), len(pixel))
    return RayHits(torch.as_tensor(fronts.depth[at]), normal)
