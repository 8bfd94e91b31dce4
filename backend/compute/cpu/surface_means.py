"""Means over rays on one surface, on the CPU: as `image.surface_means`, by the kernel."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...image.surface_means import FACING_POWER, SHARES, RayPlaces
from ..kernels.records import RaysOnSurface
from ..kernels.surface_means import mean_over_surface
from .arrays import as_arrays, row_of
from .threads import in_parallel

_MEAN_SHARES = np.array(SHARES, np.float32)


def surface_means(values: Float[Tensor, "R C"], places: RayPlaces, stride: int) -> Float[Tensor, "R C"]:
    """As `image.surface_means.surface_means`."""
    width, height = places.size_px
    row = row_of(places.pixel, width * height)
    means = torch.empty(values.shape)
    pixel, position, normal, before = as_arrays(places.pixel, places.position, places.normal, values)
    record, after = RaysOnSurface(pixel, row, width, position, normal, np.float32(places.off_plane_m)), means.numpy()
    in_parallel(
        lambda first, last: mean_over_surface(record, _MEAN_SHARES, FACING_POWER, stride, before, first, last, after),
        len(values),
    )
    return means
