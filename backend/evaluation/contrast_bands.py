"""Contrast by scale: how much the lightness of the hand's pixels varies in bands of wavelengths, in millimetres.

A band is the difference of two Gaussian blurs, whose deviations are 1 / pi of its two wavelengths; its figure is the
standard deviation of L* (CIE Lab) in it. Pixels are those of the hand that lie 1 mm inside its outline; blurs
stay among them.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..image.srgb import srgb_to_linear
from .neighbourhood import distance_px, masked_blur
from .skin_colours import lab, lightness
from .visible_surface import VisibleSurface

BANDS_MM = ((1, 2), (2, 4), (4, 8), (8, 16))
MARGIN_MM = 1.0
SPAN = "l_span"
"""Key of the span of L* from its 2nd to its 98th percentile."""
SPREAD_KEYS = "a_sd", "b_sd"
"""Keys of the deviations of a* and b*."""
TRUTH = "_truth"
"""Ends the keys of the truth's figures."""
_SPAN_SHARES = 0.02, 0.98
_FEWEST = 16  # pixels; with fewer, nothing is measured


def band_key(band_mm: tuple[int, int]) -> str:
    """Name a band's figure, such as l_1_2."""
    return f"l_{band_mm[0]}_{band_mm[1]}"


CONTRAST_KEYS = (*map(band_key, BANDS_MM), SPAN)


def contrast_figures(image: np.ndarray, truth: np.ndarray, surface: VisibleSurface) -> dict[str, float]:
    """Measure `contrast` of an image [H, W, 4] and, with other keys, of the truth, both inside the truth's outline.

    Both hold encoded colour times alpha, and alpha. A pixel's size is the hand's median.
    """
    ours, true = (torch.as_tensor(x, dtype=torch.float32) for x in (image, truth))
    hand = true[..., 3] > 0.5
    footprint_m = surface.footprint[surface.depth.isfinite() & hand]
    mm_per_px = 1e3 * float(footprint_m.median()) if footprint_m.numel() else math.nan
    figures = contrast(ours[..., :3], hand, mm_per_px)
    of_truth = contrast(true[..., :3], hand, mm_per_px)
    return figures | {name + TRUTH: value for name, value in of_truth.items()}


def contrast(image: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"], mm_per_px: float) -> dict[str, float]:
    """Measure the deviation of L* in each band, and its span, of an encoded image's hand.

    NaN where too few pixels lie inside the outline, or where a band's waves are shorter than two pixels.
    """
    if not math.isfinite(mm_per_px):
        return dict.fromkeys(CONTRAST_KEYS, math.nan)
    inside = _inside(hand, mm_per_px)
    if int(inside.sum()) < _FEWEST:
        return dict.fromkeys(CONTRAST_KEYS, math.nan)
    l_star = lightness(srgb_to_linear(image.clamp(0, 1)))
    sigmas_px = {mm: mm / math.pi / mm_per_px for mm in sorted({mm for band in BANDS_MM for mm in band})}
    blurred = {mm: masked_blur(l_star[None], inside.float(), sigma)[0][0] for mm, sigma in sigmas_px.items()}
    figures = {}
    for fine, coarse in BANDS_MM:
        deviation = float((blurred[fine] - blurred[coarse])[inside].std())
        figures[band_key((fine, coarse))] = deviation if coarse >= 2 * mm_per_px else math.nan
    low, high = np.quantile(l_star[inside].numpy(), _SPAN_SHARES)
    return figures | {SPAN: float(high - low)}


def colour_spread(image: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"], mm_per_px: float) -> dict[str, float]:
    """Measure the deviation of a* and b* of an encoded image's hand, as `contrast` does that of L*."""
    inside = _inside(hand, mm_per_px)
    if int(inside.sum()) < _FEWEST:
        return dict.fromkeys(SPREAD_KEYS, math.nan)
    deviation = lab(srgb_to_linear(image.clamp(0, 1))[inside]).std(0)
    return dict(zip(SPREAD_KEYS, deviation[1:].tolist(), strict=True))


def _inside(hand: Bool[Tensor, "H W"], mm_per_px: float) -> Bool[Tensor, "H W"]:
    return hand & (distance_px(~hand, math.inf) > MARGIN_MM / mm_per_px)
