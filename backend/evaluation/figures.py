"""All metrics of one view, keyed by their column in scores.csv; docs/make/evaluation.md defines them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from .breakdown import error_breakdown
from .distances import Distance, distance_of
from .flip import flip_map, has_flip
from .metrics import alpha_iou, psnr_db, similarities
from .seen_surface import SeenSurface


def view_figures(
    image: np.ndarray, truth: np.ndarray, surface: SeenSurface, distances: Sequence[Distance] = ()
) -> dict[str, float]:
    """Measure an image [H, W, 4] against the truth; both hold encoded colour times alpha, and alpha.

    FLIP is absent where its package is missing. A metric that is undefined for this image size or hand is NaN.
    """
    ours, true = (torch.as_tensor(x, dtype=torch.float32) for x in (image, truth))
    pair, hand = (ours[..., :3], true[..., :3]), true[..., 3] > 0.5
    figures = {"psnr_full": psnr_db(*pair), "psnr_hand": psnr_db(*pair, hand)}
    for name, found in zip(("ssim", "ms_ssim"), similarities(*pair, hand), strict=True):
        figures[name], figures[f"{name}_hand"] = found
    if has_flip():
        errors = flip_map(*pair)
        figures["flip"], figures["flip_hand"] = float(errors.mean()), float(errors[hand].mean())
    for distance in distances:
        figures[distance.name], figures[f"{distance.name}_hand"] = distance_of(distance, *pair, hand)
    breakdown = error_breakdown(ours, true, surface)
    figures |= {"alpha_iou": alpha_iou(ours[..., 3], true[..., 3]), "psnr_true_alpha": breakdown.psnr_true_alpha}
    figures |= {f"share_{name}": share for name, share in breakdown.share.items()}
    return figures | {f"area_{name}": area for name, area in breakdown.area.items()}
