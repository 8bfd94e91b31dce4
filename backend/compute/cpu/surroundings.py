"""`light.surrounding_light.near_light` by the kernels, without gradients."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...light.lighting import SurfacePoints
from ...light.shadow_maps import PointShadows
from ...light.surrounding_light import CELLS, NearLight, sky_cells
from ...light.surroundings import Patches
from ..kernels.records import NearArrays, PatchArrays, PointArrays
from ..kernels.surroundings import near_light as fill_near_light
from .arrays import as_arrays
from .lighting import lobes
from .threads import in_parallel


def near_light(
    patches: Patches, open_sky: PointShadows, shed: Float[Tensor, "P 3"], points: SurfacePoints
) -> NearLight:
    """As `light.surrounding_light.near_light`."""
    count = len(points.position)
    found = NearLight(*(torch.empty(count, *shape) for shape in ((3, 3), (2, 3), (2, 3))))
    out, at = NearArrays(*(values.numpy() for values in found)), PointArrays(*as_arrays(*points[:-1]))
    shapes = as_arrays(patches.position.T, patches.normal.T, patches.area_m2, shed.T, open_sky.lit.T)
    nearest, weights = sky_cells(shed.device)
    cells, weights = nearest.numpy().astype(np.int32), weights.numpy()
    arrays = PatchArrays(*shapes, sky_cell=cells, sky_weight=weights, cells=CELLS)
    in_parallel(lambda first, last: fill_near_light(at, arrays, lobes(), first, last, out), count)
    return found
