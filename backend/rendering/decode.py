"""The window's picture, as the network has it, becomes the frame that Blender gets; a frame becomes a picture."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..nerf.crop import Crop
from ..records.shot import DEPTH_BACKGROUND, Frame, empty_frame
from .srgb import linear_to_srgb, srgb_to_linear

# Alpha under half a level of 8 bits is none: super-resolution is never exactly 0 beside the hand.
_NOTHING = 0.5 / 255


def decode_frame(
    image: Float[Tensor, "4 h w"], depth: Float[Tensor, "h w"], window: Crop, size_px: tuple[int, int]
) -> Frame:
    """RGBA as the network has it (sRGB-encoded colour times alpha) -> scene-linear premultiplied frame, whole size."""
    alpha = image[3].clamp(0, 1)
    alpha = torch.where(alpha < _NOTHING, torch.zeros_like(alpha), alpha)
    encoded = torch.minimum(image[:3].clamp(min=0), alpha)
    straight = encoded / torch.where(alpha > 0, alpha, torch.ones_like(alpha))
    linear = srgb_to_linear(straight) * alpha
    solid_depth = torch.where((alpha >= 0.5) & depth.isfinite(), depth, torch.full_like(depth, DEPTH_BACKGROUND))
    frame = empty_frame(size_px)
    window.paste(linear.permute(1, 2, 0).cpu().numpy(), frame.rgb)
    window.paste(alpha.cpu().numpy(), frame.alpha)
    window.paste(solid_depth.cpu().numpy(), frame.depth)
    return frame


def straight_srgb(frame: Frame) -> np.ndarray:
    """[H, W, 4] float32 in 0..1 of a frame: straight colour, sRGB-encoded, and alpha."""
    alpha = frame.alpha[..., None]
    straight = torch.as_tensor(frame.rgb / np.where(alpha > 0, alpha, 1)).clamp(0, 1)
    return np.concatenate([linear_to_srgb(straight).numpy(), alpha], -1)
