"""Pixel neighbourhoods: distances to marked pixels, and Gaussian means over some of the pixels."""

from __future__ import annotations

from math import ceil, inf

import torch
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt, gaussian_filter
from torch import Tensor

_REACH_SIGMAS = 3.0
MIN_WEIGHT = 1e-6
"""Share of a Gaussian's weight below which there is no mean."""


def distance_px(marked: Bool[Tensor, "H W"], reach_px: float) -> Float[Tensor, "H W"]:
    """Measure Euclidean distance from each pixel's centre to the nearest marked one's; infinite beyond `reach_px`."""
    if not marked.any():
        return torch.full(marked.shape, inf)
    distance = torch.as_tensor(distance_transform_edt(~marked.numpy()), dtype=torch.float32)
    return torch.where(distance <= reach_px, distance, inf)


def masked_blur(
    values: Float[Tensor, "C H W"], weights: Float[Tensor, "H W"], sigma_px: float
) -> tuple[Float[Tensor, "C H W"], Float[Tensor, "H W"]]:
    """Compute Gaussian means of `values` with a weight for each pixel, and the total weight around each pixel.

    The weight outside the image is 0. The mean is 0 where the total weight is below `MIN_WEIGHT`.
    """
    reach = ceil(_REACH_SIGMAS * sigma_px)
    stacked = torch.cat([values * weights, weights[None]]).numpy()
    blurred = torch.as_tensor(gaussian_filter(stacked, sigma_px, mode="constant", radius=reach, axes=(1, 2)))
    weight = blurred[-1]
    return torch.where(weight > MIN_WEIGHT, blurred[:-1] / weight.clamp(min=MIN_WEIGHT), 0.0), weight
