"""What gates are measured by: errors on a hand's pixels, contrast by scale, and the likeness of maps in a band."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from ...backend.evaluation.contrast_bands import BANDS_MM, band_key, contrast
from ...backend.evaluation.figures import flip_map
from ...backend.evaluation.metrics import alpha_iou, psnr_db
from ...backend.evaluation.neighbourhood import masked_blur

LIKENESS_MM = (0.5, 8.0)
"""Wavelengths in which maps are compared."""
_FEWEST = 200  # pixels of a side of which contrast is measured
CONTRAST_BANDS = BANDS_MM[:3]


class PictureFigures(NamedTuple):
    """How like a rendered picture is to the true one.

    Attributes:
        psnr_db: over the hand's pixels, encoded.
        flip: mean over them.
        iou: of the silhouettes, an arm's included.
    """

    psnr_db: float
    flip: float
    iou: float


def picture_figures(ours: np.ndarray, true: np.ndarray, hand: np.ndarray) -> PictureFigures:
    """Compare encoded pictures [H, W, 4] with alpha on the pixels [H, W] of the hand; all others count as black."""
    alphas = (torch.as_tensor(picture[..., 3]) for picture in (ours, true))
    mask = torch.as_tensor(hand)
    shown, wanted = (
        torch.as_tensor(np.ascontiguousarray(picture[..., :3] * hand[..., None])).float() for picture in (ours, true)
    )
    return PictureFigures(psnr_db(shown, wanted, mask), float(flip_map(shown, wanted)[mask].mean()), alpha_iou(*alphas))


def mean_figures(figures: Sequence[PictureFigures]) -> PictureFigures:
    """Average each figure over pictures."""
    return PictureFigures(*(float(np.mean(values)) for values in zip(*figures, strict=True)))


def contrast_ratios(ours: np.ndarray, true: np.ndarray, side: np.ndarray, mm_per_px: float) -> dict[str, float]:
    """Divide our contrast of L* by the true one, in each band, over pixels [H, W] of encoded pictures [H, W, 3 or 4].

    Empty where too few pixels are on that side; NaN for a band that the pixels do not resolve.
    """
    if int(side.sum()) < _FEWEST:
        return {}
    mask = torch.as_tensor(side)
    found, wanted = (
        contrast(torch.as_tensor(np.ascontiguousarray(picture[..., :3])).float(), mask, mm_per_px)
        for picture in (ours, true)
    )
    keys = [band_key(band) for band in CONTRAST_BANDS]
    return {key: found[key] / wanted[key] for key in keys if wanted[key] > 0}


def band_passed(image: np.ndarray, inside: np.ndarray, mm_per_px: float, band_mm: tuple[float, float]) -> np.ndarray:
    """Keep the wavelengths of a band of an image [H, W, C]: the difference of two blurs that stay inside [H, W].

    A wavelength that pixels do not resolve blurs nothing.
    """
    values, weights = torch.as_tensor(np.moveaxis(image, -1, 0)).float(), torch.as_tensor(inside).float()
    fine, coarse = (_blurred(values, weights, wavelength / math.pi / mm_per_px) for wavelength in band_mm)
    return np.moveaxis((fine - coarse).numpy(), 0, -1)


def _blurred(values: torch.Tensor, weights: torch.Tensor, sigma_px: float) -> torch.Tensor:
    return masked_blur(values, weights, sigma_px)[0] if sigma_px > 0.3 else values


def likeness(ours: np.ndarray, true: np.ndarray, inside: np.ndarray, mm_per_px: float) -> float:
    """Correlate two maps [H, W, C] inside a region [H, W], in the band `LIKENESS_MM`, all channels together."""
    one, other = (band_passed(image, inside, mm_per_px, LIKENESS_MM)[inside] for image in (ours, true))
    return correlation(one - one.mean(0), other - other.mean(0))


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Compute the cosine of two arrays of one shape; NaN where one is nought."""
    norms = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / norms if norms > 0 else math.nan
