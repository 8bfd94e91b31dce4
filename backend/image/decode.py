"""Decoding: the network's output becomes a scene-linear frame, and a frame becomes an sRGB image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import threshold

from ..records.depth_profile import DepthProfile
from ..records.frame import DEPTH_BACKGROUND, Frame, empty_frame
from .crop import Crop
from .srgb import linear_to_srgb, srgb_to_linear

# Alpha below half an 8-bit level counts as 0: super-resolution is never exactly 0 beside the hand.
MIN_ALPHA = 0.5 / 255


def decode_frame(
    image: Float[Tensor, "4 h w"], depth: Float[Tensor, "h w"], window: Crop, size_px: tuple[int, int]
) -> Frame:
    """Decode RGBA (sRGB-encoded colour times alpha) as a scene-linear premultiplied frame of the whole image."""
    alpha = _clear_alpha(image[3])
    encoded = torch.minimum(image[:3].clamp(min=0), alpha)
    straight = encoded / torch.where(alpha > 0, alpha, torch.ones_like(alpha))
    return _frame(srgb_to_linear(straight) * alpha, alpha, depth, window, size_px)


def linear_frame(
    colours: Float[Tensor, "3 h w"],
    alpha: Float[Tensor, "h w"],
    depth: Float[Tensor, "h w"],
    window: Crop,
    size_px: tuple[int, int],
    profile: DepthProfile | None,
) -> Frame:
    """Make a frame of the whole image of premultiplied scene-linear colours of any brightness."""
    return replace(_frame(colours, _clear_alpha(alpha), depth, window, size_px), profile=profile)


def _clear_alpha(alpha: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    return threshold(alpha.clamp(max=1), MIN_ALPHA, 0.0)


def _frame(linear: Tensor, alpha: Tensor, depth: Tensor, window: Crop, size_px: tuple[int, int]) -> Frame:
    """Paste a crop into a frame; where alpha is 0 its colours may be anything."""
    seen = linear.permute(1, 2, 0).masked_fill(~(alpha > 0)[..., None], 0.0)  # pixel by pixel, as frames lie
    solid_depth = torch.where((alpha >= 0.5) & (depth < torch.inf), depth, DEPTH_BACKGROUND)
    frame = empty_frame(size_px)
    window.paste(seen.cpu().numpy(), frame.rgb)
    window.paste(alpha.cpu().numpy(), frame.alpha)
    window.paste(solid_depth.cpu().numpy(), frame.depth)
    return frame


def straight_srgb(frame: Frame) -> np.ndarray:
    """Convert a frame to [H, W, 4] float32 in 0..1: straight colour, sRGB-encoded, and alpha."""
    image = np.zeros((*frame.alpha.shape, 4), np.float32)
    window = _visible_window(frame)
    alpha = frame.alpha[window][..., None]
    straight = torch.as_tensor(frame.rgb[window] / np.where(alpha > 0, alpha, 1)).clamp(0, 1)
    image[window] = np.concatenate([linear_to_srgb(straight).numpy(), alpha], -1)
    return image


def srgb_pixels(frame: Frame) -> np.ndarray:
    """Convert a frame to [H, W, 4] of 8 bits: straight colour, sRGB-encoded, and alpha; rounded."""
    pixels, window = np.zeros((*frame.alpha.shape, 4), np.uint8), _visible_window(frame)
    visible = replace(frame, **{name: getattr(frame, name)[window] for name in ("rgb", "alpha", "depth")})
    pixels[window] = (straight_srgb(visible) * 255).round()
    return pixels


def _visible_window(frame: Frame) -> tuple[slice, slice]:
    """Find the rows and columns that hold all pixels with alpha."""
    rows = np.flatnonzero(frame.alpha.any(1))
    columns = np.flatnonzero(frame.alpha[rows[0] : rows[-1] + 1].any(0)) if len(rows) else rows
    first, last = ([int(one[end]) for one in (rows, columns)] if len(rows) else [0, -1] for end in (0, -1))
    return slice(first[0], last[0] + 1), slice(first[1], last[1] + 1)
