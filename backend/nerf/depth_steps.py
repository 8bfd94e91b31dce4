"""Pixels in which one part of a surface ends before another: how much they show of each (anti-aliasing).

Light, normal and colour of a pixel are those of what its centre shows. Where a finger ends before the palm, its outline
would be one of whole pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import max_pool2d

from .rays import CameraTensors
from .relighting import MIN_ALPHA

STEP_M, STEP_PX = 0.001, 4.0
"""Depths that differ by more are of two parts: template metres, and how many pixels' width."""
SPREAD = (0.0447, 0.9106, 0.0447)
"""Weights of a pixel and of its neighbours along a row or column in what it shows.

With the pixel's own square they have the variance of Cycles' filter, Blackman-Harris of 1.5 pixels."""


class DepthSteps(NamedTuple):
    """S pixels that show two parts.

    Attributes:
        pixel: [S] row * width + column.
        between_m: [S] a depth behind the nearer part and before the other.
        share: [S] of the nearer part in what the pixel shows of both.
    """

    pixel: Tensor
    between_m: Tensor
    share: Tensor

    @classmethod
    def of(
        cls, depth: Float[Tensor, " P"], samples: Float[Tensor, "N P"], camera: CameraTensors, scale: Tensor
    ) -> DepthSteps:
        """The steps of an image.

        Args:
            depth: at pixels' centres, m; infinite beside the surface.
            samples: at N places in each pixel.
            camera: of the image.
            scale: of the surface against the template.
        """
        width, height = camera.size_px
        image = depth.reshape(1, 1, height, width)
        low = -max_pool2d(-image, 3, 1, 1).flatten()
        high = max_pool2d(torch.where(image.isfinite(), image, -torch.inf), 3, 1, 1).flatten()
        is_step = high - low > STEP_M * scale + STEP_PX * low / camera.focal_px
        pixel = is_step.nonzero()[:, 0]
        between = 0.5 * (low + high)[pixel]
        of_squares = _nearer(samples[:, pixel], between)
        around, square = _around(pixel, camera.size_px), torch.full_like(depth, torch.nan)
        square[pixel] = of_squares
        # What neighbours show that have one part; of others, the share that their samples have.
        shown = torch.where(square[around].isnan(), (depth[around] < between).float(), square[around])
        row = depth.new_tensor(SPREAD)
        weight = (row[:, None] * row).flatten()[:, None] * depth[around].isfinite()
        weight[4] = row[1] ** 2
        return cls(pixel, between, (weight * shown).sum(0) / weight.sum(0))


def _nearer(samples: Float[Tensor, "N S"], between_m: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
    """The share of samples before a depth, among those of the surface."""
    return (samples < between_m).sum(0) / samples.isfinite().sum(0).clamp(min=1)


def _around(pixel: Int[Tensor, " S"], size_px: tuple[int, int]) -> Int[Tensor, "9 S"]:
    """The 3 x 3 pixels around each, within the image; the fifth is itself."""
    width, height = size_px
    x, y = pixel % width, torch.div(pixel, width, rounding_mode="floor")
    offsets = (-1, 0, 1)
    rows = [(y + dy).clamp(0, height - 1) * width for dy in offsets]
    columns = [(x + dx).clamp(0, width - 1) for dx in offsets]
    return torch.stack([row + column for row in rows for column in columns])


def blended(
    colours: Float[Tensor, "3 H W"],
    alpha: Float[Tensor, "H W"],
    depth: Float[Tensor, "H W"],
    steps: DepthSteps,
) -> Float[Tensor, "3 H W"]:
    """The image with both parts in the pixels that show them.

    A pixel has its own colour of the part in its centre, and the mean of its neighbours' of the other.

    Args:
        colours: premultiplied, of what pixels' centres show.
        alpha: of the pixels.
        depth: m.
        steps: of the image.
    """
    height, width = depth.shape
    around = _around(steps.pixel, (width, height))
    opacity = alpha.flatten()
    straight = colours.flatten(1)[:, around] / opacity[around].clamp(min=MIN_ALPHA)  # [3, 9, S]
    depth_of = depth.flatten()[around]
    is_shown = depth_of.isfinite() & (opacity[around] > MIN_ALPHA)
    is_near = depth_of < steps.between_m
    parts = [_part(straight, is_shown & side) for side in (is_near, ~is_near)]
    both = torch.lerp(parts[1][0], parts[0][0], steps.share)
    has_both = parts[0][1] & parts[1][1]
    at = steps.pixel[has_both]
    result = colours.flatten(1).clone()
    result[:, at] = both[:, has_both] * opacity[at].clamp(max=1)
    return result.reshape(colours.shape)


def _part(straight: Float[Tensor, "3 9 S"], is_of_it: Tensor) -> tuple[Float[Tensor, "3 S"], Tensor]:
    """The colour of a part in pixels, their own or the mean around them, and where it is known."""
    weight = is_of_it.to(straight.dtype)
    mean = (straight * weight).sum(1) / weight.sum(0).clamp(min=1)
    return torch.where(is_of_it[4], straight[:, 4], mean), is_of_it.any(0)
