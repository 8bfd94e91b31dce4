"""What follows from how far training is: learning rates, which terms count, and which images come next."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi
from typing import NamedTuple

import torch

from .config import TrainConfig
from .perceptual import perceptual_ramp


class ScheduleState(NamedTuple):
    """One step's place in training.

    Attributes:
        step: counted from 0.
        share: of training that lies behind, 0 to 1.
        rate: share of the learning rates.
        perceptual: share of the perceptual term's weight; 0: it does not count.
    """

    step: int
    share: float
    rate: float
    perceptual: float


@dataclass(frozen=True)
class Schedule:
    """Training's course, over steps, or over wall-clock time where the configuration has a budget of minutes."""

    config: TrainConfig

    @property
    def whole(self) -> float:
        """All of training: steps, or seconds."""
        return float(self.config.steps) if self.config.minutes is None else 60 * self.config.minutes

    def done(self, step: int, seconds: float) -> float:
        """What of `whole` lies behind, after so many steps and seconds."""
        return float(step) if self.config.minutes is None else min(seconds, self.whole)

    def is_over(self, step: int, seconds: float) -> bool:
        """Whether training ends here."""
        return self.done(step, seconds) >= self.whole

    def at(self, step: int, seconds: float = 0.0) -> ScheduleState:
        """The moment of a step that begins after so many seconds: linear warm-up, then cosine decay."""
        config, done = self.config, self.done(step, seconds)
        decay = 0.5 * (1 + cos(pi * done / self.whole))
        rate = self._warmth(step, done) * (config.final_learning_rate + (1 - config.final_learning_rate) * decay)
        return ScheduleState(step, done / self.whole, rate, perceptual_ramp(done / self.whole, config.loss))

    def _warmth(self, step: int, done: float) -> float:
        if self.config.minutes is None:
            return min(1.0, (step + 1) / self.config.warmup_steps)
        first = 1 / self.config.warmup_steps  # no step is without effect
        return min(1.0, max(first, done / (self.whole * self.config.warmup_share)))

    def eta_s(self, step: int, seconds: float, seconds_per_step: float) -> float:
        """Seconds that are left: the steps' at the measured pace, or the budget's."""
        left = self.whole - self.done(step, seconds)
        return left * seconds_per_step if self.config.minutes is None else left


def view_at(position: int, view_count: int, config: TrainConfig) -> tuple[int, int]:
    """(image, jitter set) at a place of the endless sequence: every epoch all images once.

    The order is drawn from (seed, epoch).
    """
    epoch, place = divmod(position, view_count)
    generator = torch.Generator().manual_seed(config.seed * 100_003 + epoch)
    order = torch.randperm(view_count, generator=generator)
    return int(order[place]), epoch % config.jitter_sets


def views_of_step(step: int, view_count: int, config: TrainConfig) -> list[tuple[int, int]]:
    """(image, jitter set) of all views of a step."""
    return [view_at(step * config.batch + k, view_count, config) for k in range(config.batch)]
