"""Weights of layers as `kernels.vectors.window_sums` takes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.vectors import LANES

OUTPUTS = 4 * LANES
"""Of a block."""
_MOST = 127


class PackedWeights(NamedTuple):
    """Weights of up to 64 outputs.

    Attributes:
        words: [taps, C, 64] fp32, or [taps, C / 4, 64] int32, four int8 each.
        factors: [64] by which sums of products with these are too small.
        sums: [64] of each output's numbers.
    """

    words: np.ndarray
    factors: np.ndarray
    sums: np.ndarray

    @classmethod
    def of(cls, weight: Float[Tensor, "O C h w"], is_int8: bool) -> PackedWeights:
        """At most 64 outputs; int8 takes a multiple of four inputs."""
        padded = torch.zeros(OUTPUTS, *weight.shape[1:])
        padded[: len(weight)] = weight
        values, factors = padded.permute(2, 3, 1, 0).reshape(-1, weight.shape[1], OUTPUTS), torch.ones(OUTPUTS)
        if is_int8:
            factors = padded.abs().amax((1, 2, 3)).clamp(min=1e-12) / _MOST
            values = (values / factors).round()
        sums = values.sum((0, 1))
        if is_int8:
            fours = values.to(torch.int8).reshape(len(values), -1, 4, OUTPUTS).transpose(2, 3).contiguous()
            values = fours.view(torch.int32)[..., 0]
        return cls(*(one.contiguous().numpy() for one in (values, factors, sums)))
