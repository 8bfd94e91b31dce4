"""A moving average of the weights: what an avatar is saved with."""

from __future__ import annotations

from copy import deepcopy
from typing import Generic, TypeVar

import torch
from torch import nn

Parts = TypeVar("Parts", bound=nn.Module)


class WeightAverage(Generic[Parts]):
    """Exponential moving average of a module's parameters (Polyak averaging).

    The decay rises with the steps, min(decay, (1 + step) / (10 + step)): early on the average spans a tenth of the
    steps so far, so that the first weights are soon forgotten.

    Attributes:
        module: a copy that holds the averages; buffers are the last step's.
    """

    def __init__(self, module: Parts, decay: float):
        self.module = deepcopy(module).requires_grad_(False)
        self.decay = decay

    @torch.no_grad()
    def update(self, module: Parts, step: int) -> None:
        """Take in the weights after a step, counted from 0."""
        decay = min(self.decay, (1 + step) / (10 + step))
        for average, value in zip(self.module.parameters(), module.parameters(), strict=True):
            average.lerp_(value, 1 - decay)
        for average, value in zip(self.module.buffers(), module.buffers(), strict=True):
            average.copy_(value)
