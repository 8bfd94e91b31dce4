"""The perceptual term of training: which distance, when, and of which part of the picture."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from ..evaluation.perceptual.lpips import LpipsDistance, RangeMode, load_lpips
from ..evaluation.perceptual.vgg import PerceptualLoss, load_vgg_distance
from .config import LossConfig

PerceptualDistance = PerceptualLoss | LpipsDistance


def load_perceptual_loss(
    path: Path | None, heads: Path | None = None, range_mode: RangeMode = "standard"
) -> PerceptualDistance:
    """VGG19's feature distance; LPIPS, as in the paper, where its heads are named too.

    Raises:
        LiveHandError: weights are not there, or of another network.
    """
    return load_vgg_distance(path) if heads is None else load_lpips(path, heads, range_mode)


def perceptual_ramp(share: float, config: LossConfig) -> float:
    """Share of the term's weight when so much of training is done: 0 before its own part, then a linear rise to 1."""
    since = share - (1 - config.perceptual_share)
    if since < 0 or config.perceptual == 0:
        return 0.0
    rise = config.perceptual_rise * config.perceptual_share
    return min(1.0, since / rise) if rise else 1.0


def patch_corner(alpha: Float[Tensor, "H W"], side_px: int, generator: torch.Generator | None) -> tuple[int, int]:
    """Upper left corner (row, column), even, of a patch about a pixel drawn from the hand (alpha > 0.5), or from all.

    `generator` is a CPU one.
    """
    is_hand = (alpha > 0.5).flatten().cpu()
    candidates = is_hand.nonzero()[:, 0] if is_hand.any() else torch.arange(is_hand.numel())
    drawn = int(candidates[torch.randint(len(candidates), (), generator=generator)])
    height, width = alpha.shape
    centre = divmod(drawn, width)
    low = (
        max(0, min(middle - side_px // 2, side - side_px)) for middle, side in zip(centre, (height, width), strict=True)
    )
    row, column = (corner // 2 * 2 for corner in low)
    return row, column
