"""Light and relighting on the CPU: as `nerf.lighting` and `nerf.relighting`, by the kernels, without gradients."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..geometry.shadow_maps import PointShadows
from ..nerf.light_samples import LightSamples, SkySamples
from ..nerf.lighting import (
    COEFFICIENTS,
    F0,
    NAIL_ROUGHNESS,
    ROUGHNESS,
    SCATTER_M,
    SKY_CELL_RAD,
    SMOOTH,
    WRAP,
    LightFeatures,
    LightShadows,
    Openness,
    SurfacePoints,
)
from ..nerf.rays import CameraTensors
from ..nerf.relighting import MIN_ALPHA, EnlargedRays, LitImage, RaysAround, SkinDepth, feature_maps, ray_depths
from ..nerf.surface_means import FACING_POWER, SHARES, RayPlaces
from .kernels.compiled import in_parallel
from .kernels.lighting import enlarge_pixels, mean_over_surface, ray_shares, relit_pixels, smooth_pixels, step_normals
from .kernels.lighting import light_features as fill_features
from .kernels.lighting import openness as fill_openness
from .kernels.records import (
    EnlargedArrays,
    FeatureArrays,
    LampArrays,
    Lobes,
    PointArrays,
    ProbeArrays,
    RaysOnSurface,
    RelitImage,
    SkyArrays,
)

MIN_ALPHA_32 = np.float32(MIN_ALPHA)
_MEAN_SHARES = np.array(SHARES, np.float32)


def light_features(light: LightSamples, shadows: LightShadows, points: SurfacePoints) -> LightFeatures:
    """The features of points."""
    sky, lamps = light
    count = len(points.position)
    buffers = [torch.zeros(count, *shape) for shape in ((len(lamps.rgb), 3), (3, 3), (2, 3), (2, 3), (3,))]
    out = FeatureArrays(*(values.numpy() for values in buffers))
    arrays = PointArrays(*_arrays(*points))
    sky_arrays = SkyArrays(*_arrays(*sky, *shadows.sky))
    lamp_arrays = LampArrays(*_arrays(*lamps[:-1], *shadows.lamps))
    probes = shadows.probes.probes
    at, normal, shed = _arrays(probes.position.T, probes.normal.T, shadows.probes.shed(light).T)
    probe_arrays = ProbeArrays(at, normal, np.float32(probes.area_m2), shed)
    in_parallel(
        lambda first, last: fill_features(arrays, sky_arrays, lamp_arrays, probe_arrays, _lobes(), first, last, out),
        count,
        torch.get_num_threads(),
    )
    *direct, reflected = buffers[1:]
    return LightFeatures._make((buffers[0], lamps.rgb, lamps.radius_rad, *direct, torch.ones(count, 3), reflected))


def openness(sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> Openness:
    """The openness of points with these normals."""
    found = Openness(torch.empty(len(normal)), torch.empty(len(normal), 3))
    towards, normals, lit, share, mean = _arrays(sky.towards, normal.T, shadows.lit, *found)
    in_parallel(
        lambda first, last: fill_openness(towards, normals, lit, first, last, share, mean),
        len(normal),
        torch.get_num_threads(),
    )
    return found


def surface_means(values: Float[Tensor, "R C"], places: RayPlaces, stride: int) -> Float[Tensor, "R C"]:
    """As `nerf.surface_means.surface_means`."""
    width, height = places.size_px
    row = _row_of(places.pixel, width * height)
    means = torch.empty(values.shape)
    pixel, position, normal, before = _arrays(places.pixel, places.position, places.normal, values)
    record, after = RaysOnSurface(pixel, row, width, position, normal, np.float32(places.off_plane_m)), means.numpy()
    in_parallel(
        lambda first, last: mean_over_surface(record, _MEAN_SHARES, FACING_POWER, stride, before, first, last, after),
        len(values),
        torch.get_num_threads(),
    )
    return means


def enlarged_rays(
    maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"], covered: Int[Tensor, " P"], world2cam: Tensor
) -> EnlargedRays:
    """The rays' maps at full size with their detail, at the covered pixels."""
    count, pixels = len(covered), detail[0].numel()
    buffers = (torch.empty(count, COEFFICIENTS), torch.empty(count, 3), torch.zeros(pixels))
    out = EnlargedArrays(*(values.numpy() for values in buffers))
    rows = maps.permute(1, 2, 0).flatten(0, 1)  # as they lie in memory
    arrays = _arrays(rows, detail.permute(1, 2, 0).reshape(pixels, -1), covered, world2cam)
    in_parallel(
        lambda first, last: enlarge_pixels(*arrays, maps.shape[-1], SMOOTH, MIN_ALPHA_32, first, last, out),
        count,
        torch.get_num_threads(),
    )
    return EnlargedRays(*buffers)


def smoothed_rays(large: EnlargedRays, covered: Int[Tensor, " P"], width: int) -> EnlargedRays:
    """As `nerf.relighting.smoothed_rays`."""
    row = _row_of(covered, len(large.alpha))
    smooth = large._replace(coefficients=torch.empty_like(large.coefficients), normal=torch.empty_like(large.normal))
    before, after = (EnlargedArrays(*_arrays(*rays)) for rays in (large, smooth))
    pixels = covered.numpy()
    in_parallel(
        lambda first, last: smooth_pixels(pixels, row, width, MIN_ALPHA_32, before, first, last, after),
        len(covered),
        torch.get_num_threads(),
    )
    return smooth


def shares_of_rays(
    position: Float[Tensor, "R 3"],
    pixel: Int[Tensor, " R"],
    camera: CameraTensors,
    at: Int[Tensor, " P"],
    skin: SkinDepth,
) -> Float[Tensor, "P 4"]:
    """As `nerf.relighting.shares_of_rays`."""
    depth, shares = ray_depths(position, pixel, camera), torch.empty(len(at), 4)
    arrays, out = _arrays(at, depth, skin.depth), shares.numpy()
    where = arrays[0], camera.size_px[0], *arrays[1:], np.float32(skin.edge_m)
    in_parallel(lambda first, last: ray_shares(*where, first, last, out), len(at), torch.get_num_threads())
    return shares


def normals_at_steps(
    normal: Float[Tensor, "P 3"], relief_normal: Float[Tensor, "R 3"], rays: RaysAround
) -> Float[Tensor, "P 3"]:
    """As `nerf.relighting.normals_at_steps`."""
    width, height = rays.size_px
    row, normals = _row_of(rays.pixel, width * height), torch.empty_like(normal)
    at, share, of_rays, before = _arrays(rays.at, rays.share, relief_normal, normal)
    after = normals.numpy()
    in_parallel(
        lambda first, last: step_normals(at, share, row, width, of_rays, before, first, last, after),
        len(normal),
        torch.get_num_threads(),
    )
    return normals


def relit(
    image: LitImage, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Float[Tensor, "3 H W"]:
    """Scene-linear colours of an image at twice `size_px`."""
    width, height = size_px
    maps = feature_maps(features, pixel, size_px)
    out = torch.zeros(4 * width * height, 3)
    large = (image.pixel, image.coefficients, image.normal, image.view, image.share)
    light = (features.lamp_rgb, features.lamp_radius_rad, image.nail)
    record, flat = RelitImage._make((*_arrays(*large, maps), width, *_arrays(*light))), out.numpy()
    in_parallel(
        lambda first, last: relit_pixels(record, _lobes(), first, last, flat), len(image.pixel), torch.get_num_threads()
    )
    return out.T.reshape(3, 2 * height, 2 * width)


def _row_of(pixel: Tensor, count: int) -> np.ndarray:
    """[count] where each pixel of an image stands among these, -1 for none."""
    row = np.full(count, -1, np.int32)
    row[pixel.numpy()] = np.arange(len(pixel), dtype=np.int32)
    return row


def _lobes() -> Lobes:
    constants = (np.array(values, np.float32) for values in (SCATTER_M, WRAP, np.square(ROUGHNESS)))
    return Lobes._make((*constants, *(np.float32(value) for value in (NAIL_ROUGHNESS**2, SKY_CELL_RAD, F0))))


def _arrays(*values: Tensor) -> list[np.ndarray]:
    return [value.detach().contiguous().numpy() for value in values]
