"""The benchmark itself: memory first, then every size in rounds over the moving hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch

from ..hand.model import HandModel
from .cases import PUBLISHED, WRITE, Configuration, timed_frame, timed_write
from .counts import Work, counts_of, stage_work
from .floor import floors_ms
from .machine import Peaks, measure_peaks
from .memory import memory_mb, peak_mb, reset_peak
from .motion import MotionFrame, MovingHand
from .rounds import Case, Results, measure_rounds
from .stopwatch import Stages, Stopwatch, stopwatch_of

Size = tuple[int, int]
CyclesRender = Callable[[MotionFrame, int], Stages]
"""Renders a moment with so many samples; what its stages took."""

# Moments over which coverage and floors are averaged.
_PROBES = 4
_NUMBER_BYTES = {"fp32": 4, "bf16": 2}


@dataclass(frozen=True)
class BenchmarkPlan:
    """What to measure.

    Attributes:
        sizes_px: (width, height) of the frames.
        paper_sizes_px: those of them at which the paper's configurations run too.
        cycles_sizes_px: those at which Cycles does.
        frames: of the moving hand, for each configuration and size.
        cycles_samples: per pixel.
        cycles_frames: how many of the frames Cycles renders.
        coverage: the hand's share of the image; None keeps the example's framing.
        budget_s: a configuration that has used this up at a size takes no further frames there (but two at least).
    """

    sizes_px: tuple[Size, ...] = ((167, 256), (334, 512), (1920, 1080), (3840, 2160))
    paper_sizes_px: tuple[Size, ...] = ((167, 256), (334, 512), (1920, 1080))
    cycles_sizes_px: tuple[Size, ...] = ((334, 512),)
    frames: int = 24
    cycles_samples: tuple[int, ...] = (16, 64)
    cycles_frames: int = 4
    coverage: float | None = None
    budget_s: float = 60.0


class SizeResult(NamedTuple):
    """All that was measured at one size.

    Attributes:
        size_px: (width, height).
        coverage: the hand's mean share of the image.
        taken: the costs, per case and round.
        works: per configuration that a floor is told of, the work of the stages at a few moments.
        peak_mb: per configuration; None where the system does not say.
    """

    size_px: Size
    coverage: float
    taken: Results
    works: dict[str, list[dict[str, Work]]]
    peak_mb: dict[str, float | None]

    def floors_ms(self, peaks: Peaks) -> dict[str, dict[str, float]]:
        """Per configuration and stage that it told: the mean over the moments."""
        return {name: self._floors_ms(name, peaks) for name in self.works}

    def _floors_ms(self, name: str, peaks: Peaks) -> dict[str, float]:
        told = [stage for stage in next(iter(self.taken[name].values())) if stage != WRITE]
        precision = name.rpartition("_")[2]
        of_moments = [floors_ms(works, peaks, precision, told) for works in self.works[name]]
        return {stage: float(np.mean([floors[stage] for floors in of_moments])) for stage in told}


@dataclass(frozen=True)
class Bench:
    """What stays the same over a benchmark."""

    configurations: Sequence[Configuration]
    hand: HandModel
    device: torch.device
    cycles: CyclesRender | None = None

    def run(
        self, plan: BenchmarkPlan, on_begin: Callable[[str], None] = lambda text: None
    ) -> tuple[list[SizeResult], Peaks]:
        """Measure every size, and the machine's peaks before and after each; `on_begin` is told what begins."""
        on_begin("memory")
        memory = self.measure_memory(plan)
        peaks, results = measure_peaks(self.device), []
        for size_px in plan.sizes_px:
            on_begin(f"{size_px[0]}x{size_px[1]}")
            results.append(self.measure_size(plan, size_px, memory[size_px]))
            peaks = peaks.or_better(measure_peaks(self.device))
        return results, peaks

    def measure_memory(self, plan: BenchmarkPlan) -> dict[Size, dict[str, float | None]]:
        """Peak MB over the loaded models, the avatar's own configurations first: nothing else has run by then."""
        loaded = memory_mb(self.device)
        peaks: dict[Size, dict[str, float | None]] = {size_px: {} for size_px in plan.sizes_px}
        for configuration in self.configurations:
            for size_px in sorted(self._sizes(plan, configuration)):
                peaks[size_px][configuration.name] = self._peak_mb(plan, configuration, size_px, loaded)
        return peaks

    def measure_size(self, plan: BenchmarkPlan, size_px: Size, peaks_mb: dict[str, float | None]) -> SizeResult:
        """Warm up once, then go round."""
        motion = MovingHand(self.hand, size_px, plan.coverage)
        moments = motion.moments(plan.frames)
        chosen = [c for c in self.configurations if size_px in self._sizes(plan, c)]
        cases = [self.case_of(c, motion, plan.budget_s) for c in chosen]
        cycles_cases = self._cycles_cases(plan, size_px)
        for case in cases:
            case.measure(moments[0])
        if cycles_cases and self.cycles:
            self.cycles(moments[0], 1)
        taken = measure_rounds([*cases, *cycles_cases], moments)
        probes = motion.moments(min(_PROBES, plan.frames))
        works = {c.name: [self._works(c, motion, moment) for moment in probes] for c in chosen if c.name != PUBLISHED}
        coverage = float(np.mean([motion.covered(moment) for moment in probes]))
        return SizeResult(size_px, coverage, taken, works, peaks_mb)

    def case_of(self, configuration: Configuration, motion: MovingHand, budget_s: float) -> Case:
        """A configuration as something to be measured; the avatar's own also write their frames."""
        stopwatch = stopwatch_of(self.device)

        def measure(moment: MotionFrame) -> Stages:
            stages, frame = timed_frame(partial(motion.shot, moment), configuration.render, stopwatch)
            return stages if configuration.is_paper else stages | {WRITE: timed_write(frame, Stopwatch())}

        return Case(configuration.name, measure, budget_s=budget_s)

    def _cycles_cases(self, plan: BenchmarkPlan, size_px: Size) -> list[Case]:
        if self.cycles is None or size_px not in plan.cycles_sizes_px:
            return []
        render = self.cycles

        def case(samples: int) -> Case:
            name = f"cycles_{samples}"
            return Case(name, lambda moment: render(moment, samples), plan.cycles_frames, is_foreign=True)

        return [case(samples) for samples in plan.cycles_samples]

    def _sizes(self, plan: BenchmarkPlan, configuration: Configuration) -> list[Size]:
        return [size for size in plan.sizes_px if not configuration.is_paper or size in plan.paper_sizes_px]

    def _peak_mb(
        self, plan: BenchmarkPlan, configuration: Configuration, size_px: Size, loaded_mb: float | None
    ) -> float | None:
        motion = MovingHand(self.hand, size_px, plan.coverage)
        moment = motion.moments(1)[0]
        reset_peak(self.device)
        timed_frame(partial(motion.shot, moment), configuration.render, Stopwatch())
        peak = peak_mb(self.device)
        return None if peak is None or loaded_mb is None else peak - loaded_mb

    def _works(self, configuration: Configuration, motion: MovingHand, moment: MotionFrame) -> dict[str, Work]:
        avatar = configuration.avatar
        counts = counts_of(motion.shot(moment), self.hand, avatar.config.sampler)
        return stage_work(counts, avatar, _NUMBER_BYTES[configuration.precision])
