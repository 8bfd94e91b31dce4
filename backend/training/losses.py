"""The training loss of a rendered crop: colour, alpha and features, at both resolutions (paper section 3.5).

The crop is the part of the image that holds the hand. The paper's losses see the full image, which adds only an empty
border that is right from the start: leaving it out scales the terms and changes nothing else.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..evaluation.perceptual.lpips import LpipsDistance, RangeMode, load_lpips
from ..evaluation.perceptual.vgg import PerceptualLoss, load_vgg_distance
from .config import LossConfig

PerceptualDistance = PerceptualLoss | LpipsDistance


class LossTerms(NamedTuple):
    """The terms of the loss, each [] and multiplied by its weight, so that they add up to the total.

    Attributes:
        colour_l2: squared colour error at full resolution.
        colour_l1: absolute colour error at full resolution.
        alpha: squared alpha error at full resolution.
        low: squared error of colour and alpha before super-resolution.
        perceptual: feature distance at both resolutions.
        total: what is differentiated.
    """

    colour_l2: Tensor
    colour_l1: Tensor
    alpha: Tensor
    low: Tensor
    perceptual: Tensor
    total: Tensor


def crop_loss(
    low: Float[Tensor, "4 h w"],
    image: Float[Tensor, "4 H W"],
    target: Float[Tensor, "4 H W"],
    is_inside: Bool[Tensor, "H W"],
    config: LossConfig,
    perceptual: PerceptualDistance | None,
    perceptual_factor: float = 1.0,
    generator: torch.Generator | None = None,
) -> LossTerms:
    """Compute the training loss of one crop.

    Args:
        low: RGBA before super-resolution.
        image: RGBA after super-resolution, not clamped.
        target: ground truth; its 2 x 2 means are the low-resolution ground truth, as the grids share their corners.
        is_inside: which pixels the ground truth covers; the rest of the crop is ignored.
        config: weights.
        perceptual: the perceptual distance; None leaves the term out.
        perceptual_factor: factor of the perceptual term's weight.
        generator: on the CPU; draws the patch if the perceptual term sees a patch.
    """
    if config.perceptual_region == "patch_all":
        (image, target, is_inside), (low,) = _cut((image, target, is_inside), (low,), target[3], config, generator)
    error = (image - target) * is_inside
    low_target = avg_pool2d(target[None], 2)[0]
    low_inside = avg_pool2d(is_inside[None].float(), 2)[0] == 1
    low_error = (low - low_target) * low_inside
    weighted = [
        config.colour_l2 * (error[:3] ** 2).mean(),
        config.colour_l1 * error[:3].abs().mean(),
        config.alpha_l2 * (error[3] ** 2).mean(),
        config.low_l2 * (low_error**2).mean(),
    ]
    if perceptual is None or perceptual_factor == 0:
        weighted.append(image.new_zeros(()))
    else:
        full, half = (image * is_inside, target * is_inside), (low * low_inside, low_target * low_inside)
        if config.perceptual_region == "patch":
            full, half = _cut(full, half, full[1][3], config, generator)
        distances = [perceptual(ours[None, :3], truth[None, :3]) for ours, truth in (full, half)]
        weighted.append(perceptual_factor * config.perceptual * torch.stack(distances).sum())
    return LossTerms(*weighted, total=torch.stack(weighted).sum())


def _cut(
    full: tuple[Tensor, ...],
    half: tuple[Tensor, ...],
    alpha: Tensor,
    config: LossConfig,
    generator: torch.Generator | None,
) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
    """Cut the same patch out of images at both resolutions."""
    side_px = config.perceptual_patch_px
    row, column = patch_corner(alpha, side_px, generator)
    large = slice(row, row + side_px), slice(column, column + side_px)
    small = slice(row // 2, (row + side_px) // 2), slice(column // 2, (column + side_px) // 2)
    return tuple(image[..., *large] for image in full), tuple(image[..., *small] for image in half)


def patch_corner(alpha: Float[Tensor, "H W"], side_px: int, generator: torch.Generator | None) -> tuple[int, int]:
    """Draw the upper left corner (row, column), both even, of a patch around a random pixel of the hand (alpha > 0.5).

    If no pixel shows the hand, the patch is drawn from the whole crop. `generator` is on the CPU.
    """
    is_hand = (alpha > 0.5).flatten().cpu()
    candidates = is_hand.nonzero()[:, 0] if is_hand.any() else torch.arange(is_hand.numel())
    drawn = int(candidates[torch.randint(len(candidates), (), generator=generator)])
    height, width = alpha.shape
    row, column = (
        max(0, min(centre - side_px // 2, side - side_px)) // 2 * 2
        for centre, side in zip(divmod(drawn, width), (height, width), strict=True)
    )
    return row, column


def load_perceptual_distance(
    path: Path | None, heads: Path | None = None, range_mode: RangeMode = "standard"
) -> PerceptualDistance:
    """Load VGG19's feature distance or, if the file of its linear heads is given, LPIPS as in the paper.

    Raises:
        LiveHandError: weights are missing, or belong to another network.
    """
    return load_vgg_distance(path) if heads is None else load_lpips(path, heads, range_mode)
