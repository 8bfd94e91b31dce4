"""A lower bound that values can come back from in training."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def at_least(values: Float[Tensor, "*n"], least: float) -> Float[Tensor, "*n"]:
    """`values.clamp(min=least)`, through which gradients pass that raise what lies below.

    Else a coefficient that some light drives below the bound gets no gradient any more, and stays there for good.
    """
    return _AtLeast.apply(values, least)


class _AtLeast(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values: Tensor, least: float) -> Tensor:
        ctx.save_for_backward(values > least)
        return values.clamp(min=least)

    @staticmethod
    def backward(ctx, *gradients: Tensor) -> tuple[Tensor, None]:
        (is_above,), (gradient,) = ctx.saved_tensors, gradients
        return gradient * (is_above | (gradient < 0)), None  # training goes against the gradient
