"""Volume rendering of colours and features (paper section 3.2; Mildenhall et al. 2020, equation 3)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor


class Composite(NamedTuple):
    """channels [R, C] premultiplied, alpha [R], and depth [R] m, the mean over the ray's weights (0 where alpha is)."""

    channels: Tensor
    alpha: Tensor
    depth: Tensor


# Keeps the depth's quotient finite where a ray meets nothing; far below one 8-bit level of alpha.
_MIN_ALPHA = 1e-6
# An optical depth that lets 1e-13 through.
_OPAQUE = 30.0


def composite(
    sigma_per_mm: Float[Tensor, "R N"],
    channels: Float[Tensor, "R N C"],
    t: Float[Tensor, "R N"],
    step_mm: Float[Tensor, " R"],
    is_stopped: Bool[Tensor, " R"] | None = None,
) -> Composite:
    """Composite front to back; densities per millimetre, so that the network's outputs are of order one.

    The last sample of a ray that `is_stopped` is opaque; None stops no ray.
    """
    optical_depth = sigma_per_mm * step_mm[:, None]
    if is_stopped is not None:
        last = torch.where(is_stopped, optical_depth[:, -1] + _OPAQUE, optical_depth[:, -1])
        optical_depth = torch.cat([optical_depth[:, :-1], last[:, None]], 1)
    through = torch.exp(-optical_depth)
    before = torch.exp(-(optical_depth.cumsum(1) - optical_depth))
    weights = before * (1 - through)
    alpha = weights.sum(1)
    summed = torch.bmm(weights[:, None, :], channels.to(weights.dtype))[:, 0]
    return Composite(summed, alpha, (weights * t).sum(1) / alpha.clamp(min=_MIN_ALPHA))
