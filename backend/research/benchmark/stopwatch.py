"""Wall time and core-seconds of the stages of a frame.

Core-seconds are the processor time of all threads of the process. On a shared machine they say more than wall time, but
threads that spin while they wait count as well.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch


class Cost(NamedTuple):
    """Wall time in ms and core-seconds."""

    wall_ms: float
    core_s: float


class Spread(NamedTuple):
    """Median, 10th and 90th percentile over several frames."""

    median: float
    p10: float
    p90: float


Stages = dict[str, Cost]


@dataclass
class Stopwatch:
    """Sums the time of each stage; a stage ends when the next one begins.

    Attributes:
        wall_s: the clock.
        core_s: the process's processor time.
        synchronise: waits until the device has finished; called before a clock is read.
    """

    wall_s: Callable[[], float] = time.perf_counter
    core_s: Callable[[], float] = time.process_time
    synchronise: Callable[[], None] = lambda: None
    _stages: Stages = field(default_factory=dict)
    _running: tuple[str, float, float] | None = None

    def begin(self, stage: str) -> None:
        """End the current stage, if any, and begin this one; time adds up over repeated stages."""
        self.synchronise()
        now = self.wall_s(), self.core_s()
        self._end(*now)
        self._running = (stage, *now)

    def stop(self) -> Stages:
        """End the last stage; returns the cost of every stage since the last stop, in order of first use."""
        self.synchronise()
        self._end(self.wall_s(), self.core_s())
        stages, self._stages, self._running = self._stages, {}, None
        return stages

    def _end(self, wall_s: float, core_s: float) -> None:
        if self._running is None:
            return
        stage, began_wall_s, began_core_s = self._running
        before = self._stages.get(stage, Cost(0.0, 0.0))
        wall_ms = before.wall_ms + 1000 * (wall_s - began_wall_s)
        self._stages[stage] = Cost(wall_ms, before.core_s + core_s - began_core_s)


def stopwatch_of(device: torch.device) -> Stopwatch:
    """Make a stopwatch that waits for the device."""
    return Stopwatch(synchronise=torch.cuda.synchronize) if device.type == "cuda" else Stopwatch()


def total(stages: Stages) -> Cost:
    """Sum over all stages."""
    return Cost(sum(cost.wall_ms for cost in stages.values()), sum(cost.core_s for cost in stages.values()))


def spread(values: list[float]) -> Spread:
    """Take median and percentiles of at least one value."""
    low, middle, high = np.percentile(values, (10, 50, 90))
    return Spread(float(middle), float(low), float(high))
