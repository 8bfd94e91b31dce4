"""Pictures of lit captures for the metrics: exposed by the truth, sRGB-encoded, on black."""

from __future__ import annotations

import numpy as np
import torch

from ..rendering.srgb import linear_to_srgb

WHITE_SHARE, WHITE = 99.0, 0.9
"""The truth's values on the hand at this percentile become this linear value."""
_DARKEST = 1e-6


def exposure_gain(truth: np.ndarray) -> float:
    """The factor that exposes linear premultiplied pixels [H, W, 4], by the channels of all pixels of the hand."""
    values = truth[..., :3][truth[..., 3] > 0.5]
    return WHITE / max(float(np.percentile(values, WHITE_SHARE)), _DARKEST)


def exposed(pixels: np.ndarray, gain: float) -> np.ndarray:
    """[H, W, 4] float32: linear premultiplied colour times the gain, cut off at 1 and sRGB-encoded; and alpha."""
    colour = torch.as_tensor(pixels[..., :3] * np.float32(gain), dtype=torch.float32).clamp(0, 1)
    return np.concatenate([linear_to_srgb(colour).numpy(), pixels[..., 3:]], -1).astype(np.float32)
