"""The full-size image by kernels, without gradients: as `image.{shading, depth_steps, edge_avoiding_filter}`."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

from ...field.rays import CameraTensors, direction_axes
from ...image.edge_avoiding_filter import SHARES, RaySurfacePoints
from ...image.shading import MIN_ALPHA, EnlargedRays, RaysAround, ShadingInputs, SurfaceDepth, ray_depths, ray_rows
from ...light.brdf import LEAST_ROUGHNESS
from ...light.lighting import COEFFICIENTS, BumpMapping, LightFeatures
from ...light.prefiltered_environment import SIDE
from ..kernels.brdf import MirrorArrays
from ..kernels.edges import RaysOnSurface, mean_over_surface
from ..kernels.image import (
    EnlargedArrays,
    RelitImage,
    enlarge_rows,
    relit_pixels,
)
from ..kernels.image import view_directions as fill_views
from ..kernels.steps import ray_shares, step_coefficients, step_normals
from ..reference import ReferenceBackend
from .arrays import as_arrays, row_of
from .light import lobes
from .threads import in_parallel

MIN_ALPHA_32 = np.float32(MIN_ALPHA)


def smooth_enlarged_rays(
    maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"], covered: Int[Tensor, " P"], world2cam: Tensor
) -> EnlargedRays:
    """Enlarge and smooth rays, as `image.shading.smooth_enlarged_rays`; the pixels are in order."""
    count, (height, width) = len(covered), detail.shape[1:]
    buffers = (torch.empty(count, COEFFICIENTS), torch.empty(count, 3), torch.zeros(height * width))
    out = EnlargedArrays(*(values.numpy() for values in buffers))
    rows = maps.permute(1, 2, 0).flatten(0, 1)  # as they lie in memory
    source, added, pixels, axes = as_arrays(rows, detail.permute(1, 2, 0).flatten(0, 1), covered, world2cam)
    starts = np.searchsorted(pixels, width * np.arange(height + 1))
    arrays = source, added, pixels, starts, axes, width // 2, MIN_ALPHA_32
    in_parallel(lambda first, last: enlarge_rows(*arrays, first, last, out), height)
    return EnlargedRays(*buffers)


def shares_of_rays(
    position: Float[Tensor, "R 3"],
    pixel: Int[Tensor, " R"],
    camera: CameraTensors,
    at: Int[Tensor, " P"],
    skin: SurfaceDepth,
) -> Float[Tensor, "P 4"]:
    """Compute the shares of rays, as `image.shading.shares_of_rays`."""
    depth, shares = ray_depths(position, pixel, camera), torch.empty(len(at), 4)
    arrays, out = as_arrays(at, depth, skin.depth), shares.numpy()
    where = arrays[0], camera.size_px[0], *arrays[1:], np.float32(skin.edge_m)
    in_parallel(lambda first, last: ray_shares(*where, first, last, out), len(at))
    return shares


def normals_at_steps(
    normal: Float[Tensor, "P 3"], relief_normal: Float[Tensor, "R 3"], rays: RaysAround
) -> Float[Tensor, "P 3"]:
    """Replace the normals at steps of depth, as `image.depth_steps.normals_at_steps`."""
    width, height = rays.size_px
    row, normals = row_of(rays.pixel, width * height), torch.empty_like(normal)
    at, share, of_rays, before = as_arrays(rays.at, rays.share, relief_normal, normal)
    after = normals.numpy()
    in_parallel(
        lambda first, last: step_normals(at, share, row, width, of_rays, before, first, last, after), len(normal)
    )
    return normals


def coefficients_at_steps(
    coefficients: Float[Tensor, "P 14"], alpha: Float[Tensor, " A"], maps: Float[Tensor, "34 h w"], rays: RaysAround
) -> Float[Tensor, "P 14"]:
    """Replace the coefficients at steps of depth, as `image.depth_steps.coefficients_at_steps`."""
    of_rays = maps.permute(1, 2, 0).flatten(0, 1)  # as they lie in memory
    replaced, width = coefficients.clone(memory_format=torch.contiguous_format), rays.size_px[0]
    at, share, source, opacity = as_arrays(rays.at, rays.share, of_rays, alpha)
    out = replaced.numpy()
    in_parallel(lambda first, last: step_coefficients(at, share, source, width, opacity, first, last, out), len(at))
    return replaced


def view_directions(camera: CameraTensors, pixel: Int[Tensor, " P"]) -> Float[Tensor, "P 3"]:
    """Compute `field.rays.view_directions` to the precision of fp32: rays that sample a field are more sensitive."""
    directions, width = torch.empty(len(pixel), 3), camera.size_px[0]
    at, axes = as_arrays(pixel, direction_axes(camera))
    out = directions.numpy()
    in_parallel(lambda first, last: fill_views(at, width, axes, first, last, out), len(at))
    return directions


def shade_image(
    image: ShadingInputs, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Float[Tensor, "3 H W"]:
    """Compute the scene-linear colours of an image at twice `size_px`."""
    width, height = size_px
    rays, row = ray_rows(features), row_of(pixel, width * height)
    out = torch.zeros(4 * width * height, 3)
    skin = image.skin or BumpMapping.smooth(image.normal)
    normals = image.normal, skin.surface_normal, skin.blurred_normal, skin.alpha_squared
    large = image.pixel, image.coefficients, *normals, image.view, image.share
    light = features.lamp_rgb, features.lamp_radius_rad, skin.nail, skin.sharpness
    record, flat = RelitImage._make((*as_arrays(*large, rays), row, width, *as_arrays(*light))), out.numpy()
    radiance, of_lobes = features.mirrored
    tables = as_arrays(pad(radiance, (0, 1)), of_lobes)
    sky = MirrorArrays._make((*tables, SIDE, np.float32(LEAST_ROUGHNESS)))
    in_parallel(lambda first, last: relit_pixels(record, sky, lobes(), first, last, flat), len(image.pixel))
    return out.T.reshape(3, 2 * height, 2 * width)


_MEAN_SHARES = np.array(SHARES, np.float32)


def edge_avoiding_mean(values: Float[Tensor, "R C"], hit_points: RaySurfacePoints, stride: int) -> Float[Tensor, "R C"]:
    """Average over rays, as `image.edge_avoiding_filter.edge_avoiding_mean`."""
    width, height = hit_points.size_px
    row = row_of(hit_points.pixel, width * height)
    means = torch.empty(values.shape)
    pixel, position, normal, before = as_arrays(hit_points.pixel, hit_points.position, hit_points.normal, values)
    record, after = (
        RaysOnSurface(pixel, row, width, position, normal, np.float32(hit_points.off_plane_m)),
        means.numpy(),
    )
    in_parallel(
        lambda first, last: mean_over_surface(record, _MEAN_SHARES, stride, before, first, last, after),
        len(values),
    )
    return means


class ImageKernels(ReferenceBackend):
    """The full-size image by kernels."""

    smooth_enlarged_rays = staticmethod(smooth_enlarged_rays)
    shares_of_rays = staticmethod(shares_of_rays)
    normals_at_steps = staticmethod(normals_at_steps)
    coefficients_at_steps = staticmethod(coefficients_at_steps)
    view_directions = staticmethod(view_directions)
    edge_avoiding_mean = staticmethod(edge_avoiding_mean)
    shade_image = staticmethod(shade_image)
