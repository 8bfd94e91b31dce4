"""Pictures of lit captures for the metrics: exposed by the truth, sRGB-encoded, on black."""

from __future__ import annotations

import numpy as np
import torch

from ..image.srgb import linear_to_srgb
from ..light.samples import LightSamples
from ..light.shadow_maps import Bounds
from ..records.light import Light

WHITE_SHARE, WHITE = 99.0, 0.9
"""The truth's values on the hand at this percentile become this linear value."""
LEAST_LIT = 1e-3
"""Share of a light that must come back from the brightest skin of a view: of less, exposure would show noise alone."""
_DARKEST = 1e-6


def exposure_gain(truth: np.ndarray) -> float:
    """Choose the factor that exposes linear premultiplied pixels [H, W, 4], by the channels of the hand's pixels."""
    return WHITE / max(_brightest(truth), _DARKEST)


def is_reached(truth: np.ndarray, light: Light, vertices: np.ndarray) -> bool:
    """Tell whether a light reaches what a view of linear pixels [H, W, 4] shows of a hand with vertices [V, 3]."""
    bounds = Bounds.around(torch.as_tensor(vertices, dtype=torch.float32))
    return _brightest(truth) > LEAST_LIT * float(LightSamples.of(light, bounds).unblocked(bounds.centre))


def _brightest(truth: np.ndarray) -> float:
    return float(np.percentile(truth[..., :3][truth[..., 3] > 0.5], WHITE_SHARE))


def exposed(pixels: np.ndarray, gain: float) -> np.ndarray:
    """Expose linear premultiplied colour [H, W, 4] by the gain, cut off at 1 and sRGB-encoded, float32; and alpha."""
    colour = torch.as_tensor(pixels[..., :3] * np.float32(gain), dtype=torch.float32).clamp(0, 1)
    return np.concatenate([linear_to_srgb(colour).numpy(), pixels[..., 3:]], -1).astype(np.float32)
