"""How a frame's cost grows with the hand's share of the image and with the number of hands."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ...render.composition import joined, visible_parts
from .cases import Configuration, timed_frame
from .measure import Bench, BenchmarkPlan, Size
from .motion import MotionFrame, MovingHand
from .rounds import Case, frame_spread, measure_rounds
from .stopwatch import Spread, Stages, stopwatch_of

COVERAGES = (0.03, 0.08, 0.15, 0.25, 0.4)
HANDS = (1, 2, 3)
_MAX_FRAMES = 8  # of each point


class GrowthPoint(NamedTuple):
    """One point of a curve: coverage or number of hands, and wall ms of each configuration."""

    x: float
    frame_ms: dict[str, Spread]


def grow_with_coverage(bench: Bench, plan: BenchmarkPlan, size_px: Size) -> list[GrowthPoint]:
    """Measure the same frames at increasing zoom; x is the measured coverage."""
    points = []
    for coverage in COVERAGES:
        motion = MovingHand(bench.hand, size_px, coverage)
        frames = motion.frames(min(plan.frames, _MAX_FRAMES))
        cases = [bench.case_of(c, motion, plan.budget_s) for c in bench.configurations if not c.is_paper]
        points.append(_point(float(np.mean([motion.covered(frame) for frame in frames])), cases, frames))
    return points


def grow_with_hands(bench: Bench, plan: BenchmarkPlan, size_px: Size) -> list[GrowthPoint]:
    """Measure one, two and three hands in a frame, each rendered alone and then composed."""
    motion = MovingHand(bench.hand, size_px, plan.coverage)
    frames = motion.frames(min(plan.frames, _MAX_FRAMES))
    points = []
    for hands in HANDS:
        cases = [_hands_case(bench, c, motion, hands) for c in bench.configurations if not c.is_paper]
        points.append(_point(float(hands), cases, frames))
    return points


def _hands_case(bench: Bench, configuration: Configuration, motion: MovingHand, hands: int) -> Case:
    """Render each frame of the motion once per hand and compose the results."""
    stopwatch = stopwatch_of(bench.device)

    def measure(motion_frame: MotionFrame) -> Stages:
        stages: Stages = {}
        frames = []
        for hand in range(hands):
            costs, frame = timed_frame(partial(motion.shot, motion_frame), configuration.render, stopwatch)
            stages |= {f"{stage} {hand}": cost for stage, cost in costs.items()}
            frames.append(frame)
        stopwatch.begin("compose")
        joined(visible_parts(frames))
        return stages | stopwatch.stop()

    return Case(configuration.name, measure)


def _point(x: float, cases: list[Case], frames: list[MotionFrame]) -> GrowthPoint:
    for case in cases:
        case.measure(frames[0])  # to warm up
    taken = measure_rounds(cases, frames)
    return GrowthPoint(x, {name: frame_spread(of_case)[0] for name, of_case in taken.items()})
