"""`nerf.lighting.light_features` and `nerf.relighting.relit` on the CPU, by the kernels, without gradients."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..nerf.light_samples import LightSamples
from ..nerf.lighting import (
    F0,
    ROUGHNESS,
    SCATTER_M,
    SKY_CELL_RAD,
    WRAP,
    LightFeatures,
    LightShadows,
    SurfacePoints,
)
from ..nerf.relighting import LitImage, feature_maps
from .kernels.compiled import in_parallel
from .kernels.lighting import light_features as fill_features
from .kernels.lighting import relit_pixels
from .kernels.records import FeatureArrays, LampArrays, Lobes, PointArrays, RelitImage, SkyArrays


def light_features(light: LightSamples, shadows: LightShadows, points: SurfacePoints) -> LightFeatures:
    """The features of points."""
    sky, lamps = light
    count = len(points.position)
    buffers = [torch.zeros(count, *shape) for shape in ((len(lamps.rgb), 3), (3, 3), (2, 3), (2, 3))]
    out = FeatureArrays(*(values.numpy() for values in buffers))
    arrays = PointArrays(*_arrays(*points))
    sky_arrays = SkyArrays(*_arrays(*sky, *shadows.sky))
    lamp_arrays = LampArrays(*_arrays(*lamps[:-1], *shadows.lamps))
    in_parallel(
        lambda first, last: fill_features(arrays, sky_arrays, lamp_arrays, _lobes(), first, last, out),
        count,
        torch.get_num_threads(),
    )
    ambient = shadows.mean_of_sky @ sky.flux + shadows.mean_of_lamps @ lamps.rgb
    return LightFeatures._make((buffers[0], lamps.rgb, lamps.radius_rad, *buffers[1:], ambient, None, None))


def relit(
    image: LitImage, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Float[Tensor, "3 H W"]:
    """Scene-linear colours of an image at twice `size_px`."""
    width, height = size_px
    maps = feature_maps(features, pixel, size_px)
    out = torch.zeros(4 * width * height, 3)
    large = (image.pixel, image.coefficients, image.normal, image.view)
    light = (features.lamp_rgb, features.lamp_radius_rad, features.ambient)
    record, flat = RelitImage._make((*_arrays(*large, maps), width, *_arrays(*light))), out.numpy()
    in_parallel(
        lambda first, last: relit_pixels(record, _lobes(), first, last, flat), len(image.pixel), torch.get_num_threads()
    )
    return out.T.reshape(3, 2 * height, 2 * width)


def _lobes() -> Lobes:
    constants = (np.array(values, np.float32) for values in (SCATTER_M, WRAP, np.square(ROUGHNESS)))
    return Lobes._make((*constants, np.float32(SKY_CELL_RAD), np.float32(F0)))


def _arrays(*values: Tensor) -> list[np.ndarray]:
    return [value.detach().contiguous().numpy() for value in values]
