"""Volume rendering of colours and features (paper section 3.2; Mildenhall et al. 2020, equation 3)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor


class Composite(NamedTuple):
    """R rays of N samples, volume-rendered.

    Attributes:
        channels: [R, C] premultiplied.
        alpha: [R].
        depth: [R] m, the mean over the ray's weights (0 where alpha is).
        weights: [R, N] each sample's contribution to alpha.
    """

    channels: Tensor
    alpha: Tensor
    depth: Tensor
    weights: Tensor


# Keeps the mean depth finite along transparent rays; far below one 8-bit level of alpha.
_MIN_ALPHA = 1e-6
# An optical depth of transmittance 1e-13.
_OPAQUE = 30.0


class Steps(NamedTuple):
    """The sampling of R rays of N samples.

    Attributes:
        t: [R, N] depth of each sample, m.
        step_mm: [R] length of a step along the ray, mm of the template.
        is_stopped: [R] whether the last sample is opaque whatever the field returns.
    """

    t: Tensor
    step_mm: Tensor
    is_stopped: Tensor


def composite(sigma_per_mm: Float[Tensor, " S"], channels: Float[Tensor, "S C"], steps: Steps) -> Composite:
    """Composite S = R * N samples front to back; densities per millimetre."""
    rays, count = steps.t.shape
    optical_depth = sigma_per_mm.reshape(rays, count) * steps.step_mm[:, None]
    last = torch.where(steps.is_stopped, optical_depth[:, -1] + _OPAQUE, optical_depth[:, -1])
    optical_depth = torch.cat([optical_depth[:, :-1], last[:, None]], 1)
    through = torch.exp(-optical_depth)
    before = torch.exp(-(optical_depth.cumsum(1) - optical_depth))
    weights = before * (1 - through)
    alpha = weights.sum(1)
    summed = torch.bmm(weights[:, None, :], channels.to(weights.dtype).reshape(rays, count, channels.shape[1]))[:, 0]
    return Composite(summed, alpha, (weights * steps.t).sum(1) / alpha.clamp(min=_MIN_ALPHA), weights)
