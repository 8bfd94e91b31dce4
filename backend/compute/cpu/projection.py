"""A mesh before a camera, by a kernel: as `field.rays.project`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors
from ..kernels.projection import project_vertices
from ..kernels.records import ProjectedMesh
from .arrays import as_arrays
from .threads import in_parallel


def projected_mesh(camera: CameraTensors, vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"]) -> ProjectedMesh:
    """The mesh as the camera sees it: worth its kernel where it is a fine surface."""
    count = len(vertices)
    at, corners, *matrices = as_arrays(vertices, faces, camera.K, camera.world2cam)
    mesh = ProjectedMesh(np.empty((count, 2), np.float32), np.empty(count, np.float32), corners)
    in_parallel(lambda first, last: project_vertices(at, *matrices, first, last, *mesh[:2]), count)
    return mesh
