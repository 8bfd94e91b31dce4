"""What depends on the progress of training: learning rates, the perceptual term, and the order of the images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi
from time import monotonic
from typing import NamedTuple

import torch

from .config import LossConfig, TrainConfig


class Clock:
    """Measures the seconds that a training has taken, over all its sessions.

    Args:
        spent_s: time of the sessions before this one.
        now: returns the current time, s.

    Attributes:
        waiting_s: time of this session spent waiting for images.
    """

    def __init__(self, spent_s: float = 0.0, now: Callable[[], float] = monotonic):
        self.spent_s, self.waiting_s = spent_s, 0.0
        self._now, self._start = now, now()

    @property
    def session_s(self) -> float:
        """Time since this clock was made."""
        return self._now() - self._start

    @property
    def total_s(self) -> float:
        """Time of this session and of the sessions before it."""
        return self.spent_s + self.session_s

    @property
    def data_wait_share(self) -> float:
        """Share of this session's time spent waiting for images."""
        return self.waiting_s / max(self.session_s, 1e-9)


class Interval:
    """The timer of a recurring action; it is never due if the interval is 0."""

    def __init__(self, interval_s: float, clock: Clock):
        self._interval_s, self._clock = interval_s, clock
        self._last_s = clock.session_s

    def is_due(self) -> bool:
        """Return whether the interval has passed since the last time this was true."""
        now_s = self._clock.session_s
        if not self._interval_s or now_s - self._last_s < self._interval_s:
            return False
        self._last_s = now_s
        return True


class ScheduleState(NamedTuple):
    """The schedule at one step.

    Attributes:
        step: counted from 0.
        progress: share of training that is done, 0 to 1.
        rate_factor: factor of the learning rates.
        perceptual_factor: factor of the perceptual term's weight; 0 turns the term off.
    """

    step: int
    progress: float
    rate_factor: float
    perceptual_factor: float


@dataclass(frozen=True)
class Schedule:
    """The course of training, over steps, or over wall-clock time if the configuration has a budget of minutes."""

    config: TrainConfig

    @property
    def total(self) -> float:
        """Length of training, in steps or in seconds."""
        return float(self.config.steps) if self.config.minutes is None else 60 * self.config.minutes

    def done(self, step: int, seconds: float) -> float:
        """Compute the part of `total` that is done after so many steps and seconds."""
        return float(step) if self.config.minutes is None else min(seconds, self.total)

    def is_over(self, step: int, seconds: float) -> bool:
        """Return whether training ends here."""
        return self.done(step, seconds) >= self.total

    def at(self, step: int, seconds: float = 0.0) -> ScheduleState:
        """Compute the schedule of a step that begins after so many seconds: linear warm-up, then decay."""
        config, done = self.config, self.done(step, seconds)
        progress, final = done / self.total, config.final_learning_rate
        fallen = final**progress if config.decay == "exponential" else final + (1 - final) * _cosine(progress)
        rate = self._warmup(step, done) * fallen
        return ScheduleState(step, progress, rate, perceptual_ramp(progress, config.loss))

    def remaining_s(self, step: int, seconds: float, seconds_per_step: float) -> float:
        """Estimate the time left: the rest of the steps at the measured pace, or the rest of the budget."""
        left = self.total - self.done(step, seconds)
        return left * seconds_per_step if self.config.minutes is None else left

    def _warmup(self, step: int, done: float) -> float:
        if self.config.minutes is None:
            return min(1.0, (step + 1) / self.config.warmup_steps)
        least = 1 / self.config.warmup_steps  # the first step must have an effect
        return min(1.0, max(least, done / (self.total * self.config.warmup_share)))


def _cosine(progress: float) -> float:
    """Fall from 1 to 0 along half a wave."""
    return 0.5 * (1 + cos(pi * progress))


def perceptual_ramp(progress: float, config: LossConfig) -> float:
    """Compute the factor of the perceptual weight: 0 before the last `perceptual_share`, then a linear rise to 1."""
    since = progress - (1 - config.perceptual_share)
    if since < 0 or config.perceptual == 0:
        return 0.0
    rise = config.perceptual_rise * config.perceptual_share
    return min(1.0, since / rise) if rise else 1.0


def view_at(position: int, view_count: int, config: TrainConfig) -> tuple[int, int]:
    """Find (image, jitter set) at a position of the endless sequence of epochs, each of which visits every image once.

    The order of an epoch is drawn from (seed, epoch).
    """
    epoch, place = divmod(position, view_count)
    generator = torch.Generator().manual_seed(config.seed * 100_003 + epoch)
    order = torch.randperm(view_count, generator=generator)
    return int(order[place]), epoch % config.jitter_sets


def views_of_step(step: int, view_count: int, config: TrainConfig) -> list[tuple[int, int]]:
    """List (image, jitter set) of all views of a step."""
    return [view_at(step * config.batch + k, view_count, config) for k in range(config.batch)]
