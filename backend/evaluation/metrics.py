"""Picture metrics on sRGB-encoded images [H, W, 3] in [0, 1], ground truth and render both on black."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import conv2d

# Equal images have no finite PSNR; 8-bit ones that differ by nothing visible end here.
MAX_PSNR_DB = 100.0


def psnr_db(
    image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], mask: Bool[Tensor, "H W"] | None = None
) -> float:
    """Peak signal-to-noise ratio, over the whole image as in the paper, or over a mask; NaN where the mask is empty."""
    squared = (image - truth) ** 2
    error = float(squared[mask].mean() if mask is not None else squared.mean())
    return MAX_PSNR_DB if error < 10 ** (-MAX_PSNR_DB / 10) else -10 * math.log10(error) if error == error else math.nan


def ssim(image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> float:
    """Structural similarity (Wang et al. 2004): Gaussian window 11 px, sigma 1.5, valid region, mean over channels."""
    a, b = (x.permute(2, 0, 1)[:, None].double() for x in (image, truth))
    mean_a, mean_b = _blur(a), _blur(b)
    var_a, var_b = _blur(a * a) - mean_a**2, _blur(b * b) - mean_b**2
    covariance = _blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * covariance + c2) / (var_a + var_b + c2)
    return float((luminance * structure).mean())


def _blur(x: Float[Tensor, "C 1 H W"]) -> Tensor:
    offset = torch.arange(11, dtype=x.dtype) - 5
    kernel = torch.exp(-(offset**2) / (2 * 1.5**2))
    kernel = kernel / kernel.sum()
    return conv2d(conv2d(x, kernel.view(1, 1, 11, 1)), kernel.view(1, 1, 1, 11))


def alpha_iou(alpha: Float[Tensor, "H W"], truth: Float[Tensor, "H W"]) -> float:
    """Intersection over union of the silhouettes (alpha > 0.5); 1 where both are empty."""
    a, b = alpha > 0.5, truth > 0.5
    union = int((a | b).sum())
    return int((a & b).sum()) / union if union else 1.0
