"""Image metrics on sRGB-encoded images [H, W, 3] in [0, 1], ground truth and render both on black.

`hand` [H, W] marks the pixels of the hand, where the ground truth's alpha exceeds 0.5. The windowed metrics are means
over the windows that lie wholly in the image; on the hand, over those whose centre is a pixel of the hand.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter
from torch import Tensor
from torch.nn.functional import avg_pool2d

MAX_PSNR_DB = 100.0
"""The PSNR of equal images, which would be infinite."""
_WINDOW_PX, _SIGMA_PX = 11, 1.5
_REACH_PX = _WINDOW_PX // 2
# Wang et al. 2003, table of section 3.3: the exponents of the five scales, finest first.
_SCALE_EXPONENTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


class Similarity(NamedTuple):
    """The value for the whole image and for the hand; NaN where no window fits, or none on the hand."""

    full: float
    hand: float


class _Comparison(NamedTuple):
    """Per window [h, w]: similarity, and its contrast-and-structure factor; means over the channels."""

    similarity: Tensor
    structure: Tensor


def psnr_db(
    image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], mask: Bool[Tensor, "H W"] | None = None
) -> float:
    """Compute peak signal-to-noise ratio, over the whole image as in the paper, or over a mask; NaN if it is empty."""
    squared = (image - truth) ** 2
    error = float(squared[mask].mean() if mask is not None else squared.mean())
    return MAX_PSNR_DB if error < 10 ** (-MAX_PSNR_DB / 10) else -10 * math.log10(error)


def alpha_iou(alpha: Float[Tensor, "H W"], truth: Float[Tensor, "H W"]) -> float:
    """Compute intersection over union of the silhouettes (alpha > 0.5); 1 where both are empty."""
    a, b = alpha > 0.5, truth > 0.5
    union = int((a | b).sum())
    return int((a & b).sum()) / union if union else 1.0


def similarities(
    image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]
) -> tuple[Similarity, Similarity]:
    """Return structural similarity, and multi-scale structural similarity of five scales.

    SSIM (Wang et al. 2004): Gaussian window 11 px, sigma 1.5, valid region, mean over channels. MS-SSIM is of 2003.
    MS-SSIM uses contrast and structure at four scales and the whole similarity at the fifth. Each scale is the mean of
    the one before over 2 x 2 px; an odd last row or column counts twice. A negative mean counts as 0. The result is NaN
    for images with a side under 161 px.
    """
    a, b, mask = _channels_first(image), _channels_first(truth), hand.double()[None]
    per_scale = []
    for _ in _SCALE_EXPONENTS:
        per_scale.append([_means(windows, mask[0] > 0.5) for windows in _compare(a, b)])
        a, b, mask = (avg_pool2d(x, 2, ceil_mode=True) for x in (a, b, mask))
    terms = [structure for _, structure in per_scale[:-1]] + [per_scale[-1][0]]
    return per_scale[0][0], Similarity(*(_product(means) for means in zip(*terms, strict=True)))


def _product(means: tuple[float, ...]) -> float:
    powers = (
        mean if math.isnan(mean) else max(mean, 0.0) ** e for mean, e in zip(means, _SCALE_EXPONENTS, strict=True)
    )
    return math.prod(powers)


def _means(windows: Float[Tensor, "h w"], hand: Bool[Tensor, "H W"]) -> Similarity:
    if not windows.numel():
        return Similarity(math.nan, math.nan)
    centred = hand[_REACH_PX:-_REACH_PX, _REACH_PX:-_REACH_PX]
    return Similarity(float(windows.mean()), float(windows[centred].mean()))


def _channels_first(image: Float[Tensor, "H W C"]) -> Float[Tensor, "C H W"]:
    return image.permute(2, 0, 1).double()


def _compare(a: Float[Tensor, "C H W"], b: Float[Tensor, "C H W"]) -> _Comparison:
    """Compare all windows of two images; windows in which they are equal score 1 and are not computed."""
    rows, columns = (max(side - _WINDOW_PX + 1, 0) for side in a.shape[1:])
    compared = _Comparison(*(torch.ones(rows, columns, dtype=a.dtype) for _ in range(2)))
    box = difference_box(a, b, margin_px=_WINDOW_PX - 1)
    if box is None or not rows or not columns:
        return compared
    part = _compare_windows(a[:, *box], b[:, *box])
    place = [slice(side.start, side.stop - _WINDOW_PX + 1) for side in box]
    for whole, inside in zip(compared, part, strict=True):
        whole[*place] = inside
    return compared


def difference_box(a: Float[Tensor, "C H W"], b: Float[Tensor, "C H W"], margin_px: int) -> tuple[slice, slice] | None:
    """Find (rows, columns) of the box around all pixels that differ, with a margin; None if the images are equal."""
    return mask_box((a != b).any(0), margin_px)


def mask_box(mask: Bool[Tensor, "H W"], margin_px: int) -> tuple[slice, slice] | None:
    """Find (rows, columns) of the box around a mask, with a margin within the image; None if the mask is empty."""
    if not mask.any():
        return None
    sides = []
    for axis, limit in ((1, mask.shape[0]), (0, mask.shape[1])):
        points = mask.any(axis).nonzero()
        sides.append(slice(max(int(points[0]) - margin_px, 0), min(int(points[-1]) + 1 + margin_px, limit)))
    return sides[0], sides[1]


def _compare_windows(a: Float[Tensor, "C H W"], b: Float[Tensor, "C H W"]) -> _Comparison:
    moments = _window_means(torch.stack([a, b, a * a, b * b, a * b]).flatten(0, 1)).unflatten(0, (5, -1))
    mean_a, mean_b, square_a, square_b, product = moments
    var_a, var_b, covariance = square_a - mean_a**2, square_b - mean_b**2, product - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * covariance + c2) / (var_a + var_b + c2)
    return _Comparison((luminance * structure).mean(0), structure.mean(0))


def _window_means(x: Float[Tensor, "N H W"]) -> Float[Tensor, "N h w"]:
    blurred = torch.as_tensor(gaussian_filter(x.numpy(), _SIGMA_PX, radius=_REACH_PX, axes=(1, 2)))
    return blurred[:, _REACH_PX:-_REACH_PX, _REACH_PX:-_REACH_PX]
