"""Light on the CPU: as `light.lighting`, by the kernels, without gradients."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...light.bounce import Probes, bounced_on_skin
from ...light.gloss import INDEX, NAIL_ROUGHNESS, ROUGHNESS
from ...light.light_samples import LightSamples
from ...light.lighting import (
    BELOW_HORIZON,
    SCATTER_M,
    SCATTERED_SCALE,
    SKY_CELL_RAD,
    WRAP,
    LightFeatures,
    LightShadows,
    Openness,
    SurfacePoints,
)
from ...light.shadow_maps import PointShadows
from ...light.sky_samples import SkySamples
from ..kernels.bounce import bounce
from ..kernels.lighting import light_features as fill_features
from ..kernels.lighting import openness as fill_openness
from ..kernels.records import FeatureArrays, LampArrays, Lobes, PointArrays, ProbeArrays, SkyArrays
from .arrays import as_arrays, whole_rows
from .threads import in_parallel


def light_features(light: LightSamples, shadows: LightShadows, points: SurfacePoints) -> LightFeatures:
    """The features of points."""
    sky, lamps = light
    count = len(points.position)
    vectors, of_sky, seen, scattered = (
        torch.zeros(count, *shape) for shape in ((len(lamps.rgb), 3), (3, 3), (2,), (2, 3))
    )
    out = FeatureArrays(*as_arrays(vectors, of_sky, seen, scattered))
    arrays = PointArrays(*as_arrays(*points[:-1]))
    of_sky_cells = as_arrays(sky.towards, sky.flux, sky.brightness, sky.share)
    sky_arrays = SkyArrays(*of_sky_cells, *(whole_rows(values) for values in shadows.sky))
    lamp_arrays = LampArrays(*as_arrays(*lamps[:-1], *shadows.lamps))
    in_parallel(lambda first, last: fill_features(arrays, sky_arrays, lamp_arrays, lobes(), first, last, out), count)
    probes, shed = shadows.probes.probes, shadows.probes.shed(light)
    reflected = bounced_on_skin(points.places, points.position, points.normal, probes, shed, bounced)
    return LightFeatures(
        lamp_vectors=vectors,
        lamp_rgb=lamps.rgb,
        lamp_radius_rad=lamps.radius_rad,
        sky_vectors=of_sky,
        sky_seen=seen,
        mirrored=sky.mirrored,
        near_gloss=torch.zeros(count, 2, 3),
        scattered=scattered,
        arriving=torch.ones(count, 3),
        reflected=reflected,
    )


def bounced(
    position: Float[Tensor, "R 3"], normal: Float[Tensor, "R 3"], probes: Probes, shed: Float[Tensor, "P 3"]
) -> Float[Tensor, "R 3"]:
    """As `light.bounce.bounced`."""
    arrays = ProbeArrays(*as_arrays(probes.position.T, probes.normal.T, probes.area_m2, shed.T))
    at, unit, received = as_arrays(position, normal, torch.empty(len(position), 3))
    in_parallel(lambda first, last: bounce(at, unit, arrays, first, last, received), len(position))
    return torch.as_tensor(received)


def openness(sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> Openness:
    """The openness of points with these normals."""
    found = Openness(torch.empty(len(normal)), torch.empty(len(normal), 3))
    (towards, normals, share, mean), lit = as_arrays(sky.towards, normal.T, *found), whole_rows(shadows.lit)
    in_parallel(lambda first, last: fill_openness(towards, normals, lit, first, last, share, mean), len(normal))
    return found


def lobes() -> Lobes:
    """The constants of the glossy lobes and of light in the skin."""
    constants = (np.array(values, np.float32) for values in (SCATTER_M, WRAP, SCATTERED_SCALE, np.square(ROUGHNESS)))
    return Lobes._make(
        (*constants, *(np.float32(value) for value in (NAIL_ROUGHNESS**2, SKY_CELL_RAD, INDEX**2, BELOW_HORIZON)))
    )
