"""How a frame's cost grows with the hand's share of the image and with the number of hands."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ..records.shot import Frame
from .cases import Configuration, timed_frame
from .measure import Bench, BenchmarkPlan, Size
from .motion import MotionFrame, MovingHand
from .rounds import Case, frame_spread, measure_rounds
from .stopwatch import Spread, Stages, stopwatch_of

COVERAGES = (0.03, 0.08, 0.15, 0.25, 0.4)
HANDS = (1, 2, 3)
_FRAMES = 8  # of each point, at most


class GrowthPoint(NamedTuple):
    """One point of a curve: coverage or number of hands, and wall ms per configuration."""

    x: float
    frame_ms: dict[str, Spread]


def grow_with_coverage(bench: Bench, plan: BenchmarkPlan, size_px: Size) -> list[GrowthPoint]:
    """The same frames, nearer and nearer; x is the coverage that came of it."""
    points = []
    for coverage in COVERAGES:
        motion = MovingHand(bench.hand, size_px, coverage)
        moments = motion.moments(min(plan.frames, _FRAMES))
        cases = [bench.case_of(c, motion, plan.budget_s) for c in bench.configurations if not c.is_paper]
        points.append(_point(float(np.mean([motion.covered(moment) for moment in moments])), cases, moments))
    return points


def grow_with_hands(bench: Bench, plan: BenchmarkPlan, size_px: Size) -> list[GrowthPoint]:
    """One, two and three hands in a frame: as many renders, put together by depth."""
    motion = MovingHand(bench.hand, size_px, plan.coverage)
    moments = motion.moments(min(plan.frames, _FRAMES))
    points = []
    for hands in HANDS:
        cases = [_hands_case(bench, c, motion, hands) for c in bench.configurations if not c.is_paper]
        points.append(_point(float(hands), cases, moments))
    return points


def put_together(frames: list[Frame]) -> Frame:
    """The frames over each other, in every pixel the nearest in front; depth is the nearest's."""
    depth = np.stack([frame.depth for frame in frames])
    order = depth.argsort(0)
    rgb, alpha = np.zeros_like(frames[0].rgb), np.zeros_like(frames[0].alpha)
    rgbs, alphas = np.stack([frame.rgb for frame in frames]), np.stack([frame.alpha for frame in frames])
    for layer in order:
        through = 1 - alpha
        rgb = rgb + through[..., None] * np.take_along_axis(rgbs, layer[None, ..., None], 0)[0]
        alpha = alpha + through * np.take_along_axis(alphas, layer[None], 0)[0]
    return Frame(rgb, alpha, depth.min(0))


def _hands_case(bench: Bench, configuration: Configuration, motion: MovingHand, hands: int) -> Case:
    """Renders a moment of the motion as many times as there are hands, and puts the frames together."""
    stopwatch = stopwatch_of(bench.device)

    def measure(moment: MotionFrame) -> Stages:
        stages: Stages = {}
        frames = []
        for hand in range(hands):
            took, frame = timed_frame(partial(motion.shot, moment), configuration.render, stopwatch)
            stages |= {f"{stage} {hand}": cost for stage, cost in took.items()}
            frames.append(frame)
        stopwatch.begin("put together")
        put_together(frames)
        return stages | stopwatch.stop()

    return Case(configuration.name, measure)


def _point(x: float, cases: list[Case], moments: list[MotionFrame]) -> GrowthPoint:
    for case in cases:
        case.measure(moments[0])
    taken = measure_rounds(cases, moments)
    return GrowthPoint(x, {name: frame_spread(of_case)[0] for name, of_case in taken.items()})
