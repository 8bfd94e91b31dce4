"""Pixels of the full-size image at steps of depth: of the rays around them, those on their own surface count.

Enlarged evenly, a finger before the palm would have the palm's colours and normals in its outermost pixels, in the
steps of the rays; the light of a pixel is that of rays on its surface (`shading.shares_of_rays`).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..light.lighting import COEFFICIENTS
from .maps import ray_of_pixel

LEAST_OPACITY = 1e-3
"""Of the rays that count at a pixel: with less, they have no colours."""


class RaysAround(NamedTuple):
    """Which rays P pixels of the full-size image take their light from.

    Attributes:
        pixel: [R] of the rays, in the low-resolution image.
        at: [P] pixels of the full-size image.
        share: [P, 4] as in `ShadingInputs`.
        size_px: of the low-resolution image.
    """

    pixel: Tensor
    at: Tensor
    share: Tensor
    size_px: tuple[int, int]


def neighbours(at: Int[Tensor, " P"], size_px: tuple[int, int]) -> tuple[Int[Tensor, "P 4"], Float[Tensor, "P 4"]]:
    """Find the four low-resolution pixels around pixels of the full-size image, and their bilinear weights."""
    width, height = size_px
    x, y = at % (2 * width), torch.div(at, 2 * width, rounding_mode="floor")
    columns = torch.stack([(x + 1) // 2 - 1, (x + 1) // 2], 1).clamp(0, width - 1)
    rows = torch.stack([(y + 1) // 2 - 1, (y + 1) // 2], 1).clamp(0, height - 1)
    right, below = (0.75 - 0.5 * (place % 2) for place in (x, y))
    across, down = torch.stack([1 - right, right], 1), torch.stack([1 - below, below], 1)
    return (rows[:, :, None] * width + columns[:, None]).flatten(1), (down[:, :, None] * across[:, None]).flatten(1)


def normals_at_steps(
    normal: Float[Tensor, "P 3"], relief_normal: Float[Tensor, "R 3"], rays: RaysAround
) -> Float[Tensor, "P 3"]:
    """Replace the normals at steps of depth by those of the rays that count for the light there.

    Else the light that falls on a finger would, beside its outline, shine on the normal of the palm behind it.

    Args:
        normal: unit, of the pixels.
        relief_normal: unit, at the rays.
        rays: around the pixels.
    """
    around, bilinear = neighbours(rays.at, rays.size_px)
    beside = ray_of_pixel(rays.pixel, rays.size_px[0] * rays.size_px[1])[around]
    even = bilinear * (beside >= 0)
    even = even / even.sum(1, keepdim=True)
    is_step = (rays.share - even).abs().sum(1, keepdim=True).clamp(max=1)
    of_rays = (relief_normal[beside.clamp(min=0)] * rays.share[..., None]).sum(1)
    return normalize(torch.lerp(normal, normalize(of_rays, dim=-1), is_step), dim=-1)


def coefficients_at_steps(
    coefficients: Float[Tensor, "P 14"], alpha: Float[Tensor, " A"], maps: Float[Tensor, "34 h w"], rays: RaysAround
) -> Float[Tensor, "P 14"]:
    """Replace the coefficients at steps of depth by those of the rays that count for the light there.

    Else a dark finger would, beside its outline, be as pale as the palm behind it. Rays count by their opacity: beside
    the outline of the hand, where there are no others, nothing is replaced.

    Args:
        coefficients: premultiplied, of the pixels.
        alpha: of all pixels of the full-size image.
        maps: of the rays: premultiplied coefficients first, opacity last.
        rays: around the pixels.
    """
    around, bilinear = neighbours(rays.at, rays.size_px)
    flat = maps.flatten(1).T
    opacity = flat[:, -1].clamp(0, 1)[around]
    even, share = bilinear * opacity, rays.share * opacity
    all_, total = even.sum(1, keepdim=True), share.sum(1, keepdim=True)
    is_step = (share / total.clamp(min=LEAST_OPACITY) - even / all_.clamp(min=LEAST_OPACITY)).abs().sum(1, keepdim=True)
    is_step = torch.where((total > LEAST_OPACITY) & (all_ > LEAST_OPACITY), is_step.clamp(max=1), 0)
    at = (is_step[:, 0] > 0).nonzero()[:, 0]
    of_rays = (flat[:, :COEFFICIENTS][around[at]] * rays.share[at, :, None]).sum(1) / total[at]
    visible = alpha[rays.at[at], None].clamp(0, 1)
    return coefficients.index_put((at,), torch.lerp(coefficients[at], of_rays * visible, is_step[at]))
