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
_MIN_ALPHA = 0.5 / 255


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
    alpha = _clear_alpha(alpha)
    hidden = (alpha <= 0).flatten().nonzero()[:, 0]
    pixels = colours.permute(1, 2, 0).flatten(0, 1).index_fill(0, hidden, 0.0)  # pixel by pixel, as colours lie
    seen = pixels.T.reshape(colours.shape)
    return replace(_frame(seen, alpha, depth, window, size_px), profile=profile)


def _clear_alpha(alpha: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    return threshold(alpha.clamp(max=1), _MIN_ALPHA, 0.0)


def _frame(linear: Tensor, alpha: Tensor, depth: Tensor, window: Crop, size_px: tuple[int, int]) -> Frame:
    solid_depth = torch.where((alpha >= 0.5) & (depth < torch.inf), depth, DEPTH_BACKGROUND)
    frame = empty_frame(size_px)
    window.paste(linear.permute(1, 2, 0).cpu().numpy(), frame.rgb)
    window.paste(alpha.cpu().numpy(), frame.alpha)
    window.paste(solid_depth.cpu().numpy(), frame.depth)
    return frame


def straight_srgb(frame: Frame) -> np.ndarray:
    """Convert a frame to [H, W, 4] float32 in 0..1: straight colour, sRGB-encoded, and alpha."""
    alpha = frame.alpha[..., None]
    straight = torch.as_tensor(frame.rgb / np.where(alpha > 0, alpha, 1)).clamp(0, 1)
    return np.concatenate([linear_to_srgb(straight).numpy(), alpha], -1)
