"""From rays to the picture: low-resolution maps, and super-resolution of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..records.depth_profile import DepthProfile
from .crop import MARGIN_PX, Crop
from .volume import Composite

# Low-resolution pixels enlarged at once; a larger picture is enlarged in bands, which bounds the memory.
_PIXELS_AT_ONCE = 1 << 17


class SeenRays(NamedTuple):
    """R low-resolution rays of N samples, and what is seen along them.

    Attributes:
        pixel: [R] row * width + column, in the window.
        composite: what is seen.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step of the samples, m.
    """

    pixel: Tensor
    composite: Composite
    t: Tensor
    dt: Tensor


def depth_profile(seen: SeenRays, window: Crop, size_px: tuple[int, int]) -> DepthProfile:
    """The rays' profile on the whole image's low-resolution grid."""
    in_window = np.full(window.height * window.width, -1, np.int32)
    in_window[seen.pixel.cpu().numpy()] = np.arange(len(seen.pixel), dtype=np.int32)
    row = np.full([(side + 1) // 2 for side in reversed(size_px)], -1, np.int32)
    window.paste_low_resolution(in_window.reshape(window.height, window.width), row)
    arrays = (values.float().cpu().numpy() for values in (seen.t, seen.dt, seen.composite.weights))
    return DepthProfile(row, *arrays)


def image_of(
    superres: nn.Module, low: Composite, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "4 H W"], Float[Tensor, "H W"]]:
    """Super-resolved RGBA, not clamped, and depth (infinite where no ray met the hand), at twice `size_px`."""
    maps, depth = low_resolution_maps(low, pixel, size_px)
    return enlarge_maps(superres, maps), depth.repeat_interleave(2, 0).repeat_interleave(2, 1)


def enlarge_maps(superres: nn.Module, maps: Float[Tensor, "33 h w"]) -> Float[Tensor, "4 H W"]:
    """Super-resolved RGBA; large maps in bands that overlap by the network's reach, so that no seam shows."""
    height, width = maps.shape[1:]
    rows = max(1, _PIXELS_AT_ONCE // width)
    bands = []
    for first in range(0, height, rows):
        last = min(first + rows, height)
        top, bottom = max(first - MARGIN_PX, 0), min(last + MARGIN_PX, height)
        band = maps[None, :, top:bottom].contiguous(memory_format=torch.channels_last)
        bands.append(superres(band)[0, :, 2 * (first - top) : 2 * (last - top)])
    return bands[0] if len(bands) == 1 else torch.cat(bands, 1)


def low_resolution_maps(
    low: Composite, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "33 h w"], Float[Tensor, "h w"]]:
    """Rays scattered into maps [colour 3, features 29, alpha 1], zero where there is no ray; and depth."""
    width, height = size_px
    values = torch.cat([low.channels, low.alpha[:, None].to(low.channels.dtype)], -1)
    maps = values.new_zeros(width * height, values.shape[1]).index_put((pixel,), values)
    depth = torch.where(low.alpha > 0, low.depth, torch.full_like(low.depth, torch.inf))
    depth = low.depth.new_full((width * height,), torch.inf).index_put((pixel,), depth)
    return maps.T.reshape(-1, height, width), depth.reshape(height, width)
