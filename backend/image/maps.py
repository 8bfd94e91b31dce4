"""From rays to the image: low-resolution maps, and their super-resolution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..field.rays import RenderedRays
from ..field.volume import Composite
from ..records.depth_profile import DepthProfile
from .crop import MARGIN_PX, Crop


def depth_profile(rays: RenderedRays, crop: Crop, size_px: tuple[int, int]) -> DepthProfile:
    """Return the depth profile of rays at half the image's size."""
    in_crop = np.full(crop.height * crop.width, -1, np.int32)
    in_crop[rays.pixel.cpu().numpy()] = np.arange(len(rays.pixel), dtype=np.int32)
    row = rows_of_image(in_crop.reshape(crop.height, crop.width), crop, size_px)
    arrays = (values.float().cpu().numpy() for values in (rays.t, rays.dt, rays.composite.weights))
    return DepthProfile(row, *arrays, ray_px=2)


def rows_of_image(in_crop: Int[np.ndarray, "h w"], crop: Crop, size_px: tuple[int, int]) -> np.ndarray:
    """Find the rays [H, W] through the pixels of an image from those of a crop at half its size, -1 for none."""
    width, height = size_px
    row = np.full(((height + 1) // 2, (width + 1) // 2), -1, np.int32)
    crop.paste_low_resolution(in_crop, row)
    return row.repeat(2, 0).repeat(2, 1)[:height, :width]


def ray_of_pixel(pixel: Int[Tensor, " R"], count: int) -> Int[Tensor, " P"]:
    """Find the ray of each of the `count` pixels of an image, -1 for none."""
    return torch.full((count,), -1, device=pixel.device).index_put(
        (pixel,), torch.arange(len(pixel), device=pixel.device)
    )


def rays_at(
    rays: Int[Tensor, " P"], x: Int[Tensor, "*n"], y: Int[Tensor, "*n"], size_px: tuple[int, int]
) -> Int[Tensor, "*n"]:
    """Take the rays of pixels from `ray_of_pixel` of an image of this size; beside it there are none, -1."""
    width, height = size_px
    is_inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return torch.where(is_inside, rays[y.clamp(0, height - 1) * width + x.clamp(0, width - 1)], -1)


def image_of(
    superres: Callable[[Tensor], Tensor], low: Composite, pixel: Tensor, size_px: tuple[int, int], scale: int
) -> tuple[Float[Tensor, "4 H W"], Float[Tensor, "H W"]]:
    """Compute super-resolved RGBA, not clamped, and depth (infinite where no ray meets the hand).

    Args:
        superres: the network.
        low: the rays.
        pixel: of the rays, in an image of `size_px`.
        size_px: of the rays' image.
        scale: of the result to it (`SuperResConfig.scale`).
    """
    maps, depth = low_resolution_maps(low, pixel, size_px)
    if scale == 1:
        return superres(maps[None])[0], depth
    return enlarge_maps(superres, maps), depth.repeat_interleave(2, 0).repeat_interleave(2, 1)


def enlarge_maps(
    superres: Callable[[Tensor], Tensor], maps: Float[Tensor, "C h w"], pixels_per_band: int = 1 << 17
) -> Float[Tensor, "D H W"]:
    """Super-resolve maps to RGBA; large ones in bands that overlap by the network's reach, so that no seam shows."""
    height, width = maps.shape[1:]
    rows = max(1, pixels_per_band // width)
    bands = []
    for first in range(0, height, rows):
        last = min(first + rows, height)
        top, bottom = max(first - MARGIN_PX, 0), min(last + MARGIN_PX, height)
        band = maps[None, :, top:bottom].contiguous(memory_format=torch.channels_last)
        bands.append(superres(band)[0, :, 2 * (first - top) : 2 * (last - top)])
    if len(bands) == 1:
        return bands[0]
    return torch.cat([band.permute(1, 2, 0) for band in bands]).permute(2, 0, 1)  # pixel by pixel, as bands lie


def low_resolution_maps(
    low: Composite, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "C h w"], Float[Tensor, "h w"]]:
    """Scatter rays into maps [colour 3, features 29, alpha 1], zero where there is no ray; and depth."""
    width, height = size_px
    values = torch.cat([low.channels, low.alpha[:, None].to(low.channels.dtype)], -1)
    maps = values.new_zeros(width * height, values.shape[1]).index_put_((pixel,), values)
    depth = torch.where(low.alpha > 0, low.depth, torch.inf)
    depth = low.depth.new_full((width * height,), torch.inf).index_put((pixel,), depth)
    return maps.T.reshape(-1, height, width), depth.reshape(height, width)
