"""What lies around a pixel: distances to the nearest of some pixels, and Gaussian means of some pixels only."""

from __future__ import annotations

from math import ceil, inf

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import conv2d, pad

_REACH_SIGMAS = 3.0
# Below this share of a Gaussian's weight, nothing is known of a place.
MIN_WEIGHT = 1e-6


def distance_px(marked: Bool[Tensor, "H W"], reach_px: float) -> Float[Tensor, "H W"]:
    """Euclidean distance from each pixel's centre to the nearest marked one's; infinite beyond `reach_px`."""
    squared = torch.where(marked, 0.0, inf)
    for axis in (0, 1):
        reach = min(int(reach_px), squared.shape[axis] - 1)
        padded = pad(squared, (reach, reach, 0, 0) if axis else (0, 0, reach, reach), value=inf)
        moved = [padded.narrow(axis, reach + k, squared.shape[axis]) + k * k for k in range(-reach, reach + 1)]
        squared = torch.stack(moved).amin(0)
    return torch.where(squared <= reach_px**2, squared.sqrt(), inf)


def masked_blur(
    values: Float[Tensor, "C H W"], weights: Float[Tensor, "H W"], sigma_px: float
) -> tuple[Float[Tensor, "C H W"], Float[Tensor, "H W"]]:
    """Gaussian-weighted means of `values`, each counted `weights` times, and the weight found around each pixel.

    Outside the picture there is no weight. The mean is 0 where hardly any weight is found.
    """
    blurred = _blur(torch.cat([values * weights, weights[None]]), sigma_px)
    weight = blurred[-1]
    return torch.where(weight > MIN_WEIGHT, blurred[:-1] / weight.clamp(min=MIN_WEIGHT), 0.0), weight


def _blur(pictures: Float[Tensor, "N H W"], sigma_px: float) -> Float[Tensor, "N H W"]:
    reach = ceil(_REACH_SIGMAS * sigma_px)
    offset = torch.arange(-reach, reach + 1, dtype=pictures.dtype)
    kernel = torch.exp(-(offset**2) / (2 * sigma_px**2))
    kernel = (kernel / kernel.sum()).expand(len(pictures), 1, -1)
    down = conv2d(pictures, kernel[..., None], padding=(reach, 0), groups=len(pictures))
    return conv2d(down, kernel[:, :, None], padding=(0, reach), groups=len(pictures))
