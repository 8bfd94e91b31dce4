"""The full-size image, without gradients: as `image.shading` and `image.edge_avoiding_filter`."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pixel_unshuffle

from ...field.rays import CameraTensors
from ...image.edge_avoiding_filter import RaySurfacePoints
from ...image.shading import EnlargedRays, RaysAround, ShadingInputs, SurfaceDepth, ray_depths, ray_rows
from ...light.lighting import COEFFICIENTS, BumpMapping, LightFeatures
from ..reference import ReferenceBackend
from .kernels.compiled import launch
from .kernels.pixels import (
    enlarge_pixels,
    mean_over_surface,
    ray_shares,
    smooth_pixels,
    step_coefficients,
    step_normals,
)
from .kernels.relight import relit_pixels

_VALUES = COEFFICIENTS + 4
"""Of a pixel: coefficients, normal, and its weight in the means over pixels."""


def row_of(pixel: Int[Tensor, " R"], count: int) -> Int[Tensor, " P"]:
    """Find the row of each pixel of an image of that size among these, -1 for none."""
    row = torch.full((count,), -1, dtype=torch.int32, device=pixel.device)
    row[pixel] = torch.arange(len(pixel), dtype=torch.int32, device=pixel.device)
    return row


def smooth_enlarged_rays(
    maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"], covered: Int[Tensor, " P"], world2cam: Tensor
) -> EnlargedRays:
    """Enlarge and smooth rays, as `image.shading.smooth_enlarged_rays`."""
    count, (height, width) = len(covered), detail.shape[1:]
    values, alphas = maps.new_zeros(height * width, _VALUES), maps.new_zeros(height * width)
    tail = pixel_unshuffle(detail[None], 2)[0].flatten(1).T
    launch(enlarge_pixels, count, maps, tail, width // 2, 0, covered, world2cam, values, alphas)
    coefficients, normal = maps.new_empty(count, COEFFICIENTS), maps.new_empty(count, 3)
    launch(smooth_pixels, count, values, covered, width, coefficients, normal)
    return EnlargedRays(coefficients, normal, alphas)


def shares_of_rays(
    position: Float[Tensor, "R 3"],
    pixel: Int[Tensor, " R"],
    camera: CameraTensors,
    at: Int[Tensor, " P"],
    skin: SurfaceDepth,
) -> Float[Tensor, "P 4"]:
    """Compute the shares of rays, as `image.shading.shares_of_rays`."""
    shares, depth = position.new_empty(len(at), 4), ray_depths(position, pixel, camera)
    launch(ray_shares, len(at), at, camera.size_px[0], depth, skin.depth, skin.edge_m.reshape(1), shares)
    return shares


def normals_at_steps(
    normal: Float[Tensor, "P 3"], relief_normal: Float[Tensor, "R 3"], rays: RaysAround
) -> Float[Tensor, "P 3"]:
    """Replace the normals at steps of depth, as `image.depth_steps.normals_at_steps`."""
    width, height = rays.size_px
    row, out = row_of(rays.pixel, width * height), torch.empty_like(normal, memory_format=torch.contiguous_format)
    launch(step_normals, len(normal), rays.at, rays.share, row, width, relief_normal, normal, out)
    return out


def coefficients_at_steps(
    coefficients: Float[Tensor, "P 14"], alpha: Float[Tensor, " A"], maps: Float[Tensor, "34 h w"], rays: RaysAround
) -> Float[Tensor, "P 14"]:
    """Replace the coefficients at steps of depth, as `image.depth_steps.coefficients_at_steps`."""
    replaced = coefficients.clone(memory_format=torch.contiguous_format)
    launch(step_coefficients, len(replaced), rays.at, rays.share, maps, alpha, replaced)
    return replaced


def shade_image(
    image: ShadingInputs, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Float[Tensor, "3 H W"]:
    """Compute the scene-linear colours of an image at twice `size_px`."""
    width, height = size_px
    skin = image.skin or BumpMapping.smooth(image.normal)
    normals = image.normal, skin.surface_normal, skin.blurred_normal, skin.alpha_squared
    rays = ray_rows(features), row_of(pixel, width * height), width
    lamps = features.lamp_rgb, features.lamp_radius_rad, skin.nail, skin.sharpness
    out = image.normal.new_zeros(4 * width * height, 3)
    given = image.pixel, image.coefficients, *normals, image.view, image.share, *rays, *lamps, *features.mirrored
    launch(relit_pixels, len(image.pixel), *given, out)
    return out.T.reshape(3, 2 * height, 2 * width)


def edge_avoiding_mean(values: Float[Tensor, "R C"], hit_points: RaySurfacePoints, stride: int) -> Float[Tensor, "R C"]:
    """Average over rays, as `image.edge_avoiding_filter.edge_avoiding_mean`."""
    width, height = hit_points.size_px
    row, means = (
        row_of(hit_points.pixel, width * height),
        torch.empty_like(values, memory_format=torch.contiguous_format),
    )
    off_plane_m = values.new_tensor([hit_points.off_plane_m])
    where = (
        hit_points.pixel,
        row,
        width,
        hit_points.position,
        hit_points.normal,
        off_plane_m,
        stride,
        values.new_empty(0),
    )
    launch(mean_over_surface, len(values), *where, values, means)
    return means


class ImageStages(ReferenceBackend):
    """The full-size image by Warp."""

    smooth_enlarged_rays = staticmethod(smooth_enlarged_rays)
    shares_of_rays = staticmethod(shares_of_rays)
    normals_at_steps = staticmethod(normals_at_steps)
    coefficients_at_steps = staticmethod(coefficients_at_steps)
    shade_image = staticmethod(shade_image)
    edge_avoiding_mean = staticmethod(edge_avoiding_mean)
