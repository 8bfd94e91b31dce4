"""What a rendered window is compared by: colour, alpha, and features, at both resolutions (paper section 3.5).

The window is the part of the image that holds the hand. The paper's losses see the full image; what that adds is an
empty border, which is right from the start: leaving it out does no more than scale the terms.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .config import LossConfig
from .perceptual import PerceptualDistance, patch_corner


class LossTerms(NamedTuple):
    """The loss by its terms, each [] and already times its weight, so that they add up to the total.

    Attributes:
        colour_l2: squared colour error, full resolution.
        colour_l1: absolute colour error, full resolution.
        alpha: squared alpha error, full resolution.
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
    rise: float = 1.0,
    generator: torch.Generator | None = None,
) -> LossTerms:
    """The training loss of one window.

    Args:
        low: RGBA before super-resolution.
        image: RGBA after it, not clamped.
        target: ground truth; its 2 x 2 means are the low-resolution truth, as the grids share their corners.
        is_inside: which pixels the ground truth covers; the rest of the window counts nothing.
        config: weights.
        perceptual: None leaves the term out.
        rise: share of the perceptual term's weight, from `perceptual_ramp`.
        generator: on the CPU; draws the patch where the perceptual term sees one.
    """
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
    if perceptual is None or rise == 0:
        weighted.append(image.new_zeros(()))
    else:
        full, half = (image * is_inside, target * is_inside), (low * low_inside, low_target * low_inside)
        if config.perceptual_region == "patch":
            full, half = _patches(full, half, config.perceptual_patch_px, generator)
        distances = [perceptual(ours[None, :3], truth[None, :3]) for ours, truth in (full, half)]
        weighted.append(rise * config.perceptual * torch.stack(distances).sum())
    return LossTerms(*weighted, total=torch.stack(weighted).sum())


def _patches(
    full: tuple[Tensor, Tensor], half: tuple[Tensor, Tensor], side_px: int, generator: torch.Generator | None
) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    """The same patch of ours and the truth, at both resolutions."""
    row, column = patch_corner(full[1][3], side_px, generator)
    large = slice(row, row + side_px), slice(column, column + side_px)
    small = slice(row // 2, (row + side_px) // 2), slice(column // 2, (column + side_px) // 2)
    return (full[0][:, *large], full[1][:, *large]), (half[0][:, *small], half[1][:, *small])
