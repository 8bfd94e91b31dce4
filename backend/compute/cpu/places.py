"""Where points lie on a mesh, by a kernel: as `light.bounce.SkinPlaces.of`."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...geometry.mesh import PosedMesh
from ...light.bounce import SkinPlaces
from ..kernels.places import skin_places as fill_places
from .arrays import as_arrays
from .threads import in_parallel


def skin_places(
    mesh: PosedMesh, faces: Int[Tensor, "F 3"], face: Int[Tensor, " R"], position: Float[Tensor, "R 3"]
) -> SkinPlaces:
    """The places of points near faces; face -1 is none."""
    count = len(face)
    places = SkinPlaces(torch.empty(count, 3, dtype=faces.dtype), torch.empty(count, 3))
    arrays = as_arrays(mesh.vertices, faces, face, position)
    vertex, weight = (values.numpy() for values in places)
    in_parallel(lambda first, last: fill_places(*arrays, first, last, vertex, weight), count)
    return places
