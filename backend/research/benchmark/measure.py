"""The benchmark: memory first, then every size in rounds over the moving hand.

On the CPU this is the process's resident memory, which includes what earlier configurations left in the allocator: a
peak is an upper bound. On CUDA it is the memory that torch has allocated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ...hand.model import HandModel
from .cases import PUBLISHED, WRITE, Configuration, timed_frame, timed_write
from .counts import Work, counts_of, stage_work
from .machine import Peaks, measure_peaks
from .motion import MotionFrame, MovingHand
from .rounds import Case, Results, measure_rounds
from .stopwatch import Stages, Stopwatch, stopwatch_of

# The stage that does the work of a stage that a renderer does not report: in the fused backend, which reports
# `rasterise`, and in the reference backend.
_DONE_WITHIN_FUSED = {"gather": "sample", "volume": "sample"}
_DONE_WITHIN_REFERENCE = {"rasterise": "sample", "gather": "field", "volume": "field"}


def floor_ms(work: Work, peaks: Peaks, precision: str) -> float:
    """Compute one stage's floor; `precision` is that of the networks."""
    is_half = work.unit == "network" and precision == "bf16"
    arithmetic_s = work.flop / (peaks.reduced_flops if is_half else peaks.fp32_flops)
    return 1000 * max(arithmetic_s, work.bytes / peaks.bytes_per_s)


def floors_ms(works: Mapping[str, Work], peaks: Peaks, precision: str, reported: Iterable[str]) -> dict[str, float]:
    """Compute the floors of the reported stages; that of any other stage is added to the stage that does its work."""
    floors = dict.fromkeys(reported, 0.0)
    done_within = _DONE_WITHIN_FUSED if "rasterise" in floors else _DONE_WITHIN_REFERENCE
    for stage, work in works.items():
        owner = stage if stage in floors else done_within.get(stage, stage)
        if owner in floors:
            floors[owner] += floor_ms(work, peaks, precision)
    return floors


_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")
_RESET_PEAK = "5"  # see proc(5)


def memory_mb(device: torch.device) -> float | None:
    """Read the memory in use now; None where the system does not report it."""
    if device.type == "cuda":
        return torch.cuda.memory_allocated(device) / 1e6
    return _status_mb("VmRSS")


def reset_peak(device: torch.device) -> None:
    """Forget the peak so far."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return
    with suppress(OSError):
        _CLEAR.write_text(_RESET_PEAK)


def peak_mb(device: torch.device) -> float | None:
    """Read the peak since the last reset; None where the system does not report it."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e6
    return _status_mb("VmHWM")


def _status_mb(name: str) -> float | None:
    """Read an entry of /proc/self/status, which only Linux has."""
    if not _STATUS.is_file():
        return None
    lines = [line for line in _STATUS.read_text().splitlines() if line.startswith(f"{name}:")]
    return int(lines[0].split()[1]) * 1024 / 1e6 if lines else None


Size = tuple[int, int]
CyclesRender = Callable[[MotionFrame, int], Stages]
"""(frame of the motion, samples per pixel) -> the cost of each stage."""

_COUNTED_FRAMES = 4  # over which coverage and floors are averaged
_NUMBER_BYTES = {"fp32": 4, "bf16": 2}


@dataclass(frozen=True)
class BenchmarkPlan:
    """What to measure.

    Attributes:
        sizes_px: (width, height) of the frames.
        paper_sizes_px: sizes at which the paper's configurations run too.
        cycles_sizes_px: sizes at which Cycles runs too.
        frames: frames of the moving hand for each configuration and size.
        cycles_samples: samples per pixel.
        cycles_frames: how many of the frames Cycles renders.
        coverage: the hand's share of the image; None keeps the example's framing.
        budget_s: time after which a configuration renders no further frames at a size; it renders at least two.
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
    """All measurements at one size.

    Attributes:
        size_px: (width, height).
        coverage: the hand's mean share of the image.
        taken: the costs, per case and round.
        works: per configuration with a floor, the work of the stages in a few frames.
        peak_mb: peak memory per configuration; None where the system does not report it.
    """

    size_px: Size
    coverage: float
    taken: Results
    works: dict[str, list[dict[str, Work]]]
    peak_mb: dict[str, float | None]

    def floors_ms(self, peaks: Peaks) -> dict[str, dict[str, float]]:
        """Average the floors per configuration and reported stage, over the counted frames."""
        return {name: self._floors_ms(name, peaks) for name in self.works}

    def _floors_ms(self, name: str, peaks: Peaks) -> dict[str, float]:
        reported = [stage for stage in next(iter(self.taken[name].values())) if stage != WRITE]
        precision = name.rpartition("_")[2]
        of_frames = [floors_ms(works, peaks, precision, reported) for works in self.works[name]]
        return {stage: float(np.mean([floors[stage] for floors in of_frames])) for stage in reported}


@dataclass(frozen=True)
class Bench:
    """The configurations, hand and device of a benchmark; `cycles` is None where Cycles does not run."""

    configurations: Sequence[Configuration]
    hand: HandModel
    device: torch.device
    cycles: CyclesRender | None = None

    def run(
        self, plan: BenchmarkPlan, on_begin: Callable[[str], None] = lambda text: None
    ) -> tuple[list[SizeResult], Peaks]:
        """Measure every size, and the machine's peaks before and after each; `on_begin` receives each part's name."""
        on_begin("memory")
        memory = self.measure_memory(plan)
        peaks, results = measure_peaks(self.device), []
        for size_px in plan.sizes_px:
            on_begin(f"{size_px[0]}x{size_px[1]}")
            results.append(self.measure_size(plan, size_px, memory[size_px]))
            peaks = peaks.or_better(measure_peaks(self.device))
        return results, peaks

    def measure_memory(self, plan: BenchmarkPlan) -> dict[Size, dict[str, float | None]]:
        """Measure peak MB above the loaded models. The avatar's own configurations come first, before all else."""
        loaded = memory_mb(self.device)
        peaks: dict[Size, dict[str, float | None]] = {size_px: {} for size_px in plan.sizes_px}
        for configuration in self.configurations:
            for size_px in sorted(self._sizes(plan, configuration)):
                peaks[size_px][configuration.name] = self._peak_mb(plan, configuration, size_px, loaded)
        return peaks

    def measure_size(self, plan: BenchmarkPlan, size_px: Size, peaks_mb: dict[str, float | None]) -> SizeResult:
        """Render one frame with every case to warm up, then measure all rounds."""
        motion = MovingHand(self.hand, size_px, plan.coverage)
        frames = motion.frames(plan.frames)
        chosen = [c for c in self.configurations if size_px in self._sizes(plan, c)]
        cases = [self.case_of(c, motion, plan.budget_s) for c in chosen]
        cycles_cases = self._cycles_cases(plan, size_px)
        for case in cases:
            case.measure(frames[0])
        if cycles_cases and self.cycles:
            self.cycles(frames[0], 1)
        taken = measure_rounds([*cases, *cycles_cases], frames)
        counted = motion.frames(min(_COUNTED_FRAMES, plan.frames))
        works = {c.name: [self._works(c, motion, frame) for frame in counted] for c in chosen if c.name != PUBLISHED}
        coverage = float(np.mean([motion.covered(frame) for frame in counted]))
        return SizeResult(size_px, coverage, taken, works, peaks_mb)

    def case_of(self, configuration: Configuration, motion: MovingHand, budget_s: float) -> Case:
        """Make a case that renders a configuration; the avatar's own configurations also write their frames."""
        stopwatch = stopwatch_of(self.device)

        def measure(motion_frame: MotionFrame) -> Stages:
            stages, frame = timed_frame(partial(motion.shot, motion_frame), configuration.render, stopwatch)
            return stages if configuration.is_paper else stages | {WRITE: timed_write(frame, Stopwatch())}

        return Case(configuration.name, measure, budget_s=budget_s)

    def _cycles_cases(self, plan: BenchmarkPlan, size_px: Size) -> list[Case]:
        if self.cycles is None or size_px not in plan.cycles_sizes_px:
            return []
        render = self.cycles

        def case(samples: int) -> Case:
            name = f"cycles_{samples}"
            return Case(name, lambda frame: render(frame, samples), plan.cycles_frames, evicts_caches=True)

        return [case(samples) for samples in plan.cycles_samples]

    def _sizes(self, plan: BenchmarkPlan, configuration: Configuration) -> list[Size]:
        return [size for size in plan.sizes_px if not configuration.is_paper or size in plan.paper_sizes_px]

    def _peak_mb(
        self, plan: BenchmarkPlan, configuration: Configuration, size_px: Size, loaded_mb: float | None
    ) -> float | None:
        motion = MovingHand(self.hand, size_px, plan.coverage)
        frame = motion.frames(1)[0]
        reset_peak(self.device)
        timed_frame(partial(motion.shot, frame), configuration.render, Stopwatch())
        peak = peak_mb(self.device)
        return None if peak is None or loaded_mb is None else peak - loaded_mb

    def _works(self, configuration: Configuration, motion: MovingHand, frame: MotionFrame) -> dict[str, Work]:
        avatar = configuration.avatar
        counts = counts_of(motion.shot(frame), self.hand, configuration.sampler)
        return stage_work(counts, avatar, _NUMBER_BYTES[configuration.precision])
