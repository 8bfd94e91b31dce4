"""How long a frame takes, pose to RGBA in memory: all rows in turns, on the same moments of the moving hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch

from ...evaluation.shot_renderer import ShotRenderer
from ...hand.model import HandModel
from ...records.frame import Frame
from ...records.render_hooks import Stage
from ...records.shot import Shot
from ..benchmark.cases import timed_frame
from ..benchmark.motion import MotionFrame, MovingHand
from ..benchmark.rounds import Case, frame_spread, measure_rounds
from ..benchmark.stopwatch import Stages, stopwatch_of

_BUDGET_S = 60.0


@dataclass(frozen=True)
class SpeedPlan:
    """What is timed.

    Attributes:
        size_px: (width, height).
        frames: rounds; slow rows sit out after a minute, but render twice.
    """

    size_px: tuple[int, int] = (334, 512)
    frames: int = 12


def measure_speed(
    renderers: Mapping[str, ShotRenderer], hand: HandModel, plan: SpeedPlan, device: torch.device
) -> dict[str, dict[str, Any]]:
    """Measure by row: milliseconds (median, 10 %, 90 %), core-seconds, frames a second, number of timed frames."""
    motion = MovingHand(hand, plan.size_px)
    frames = motion.frames(plan.frames)
    cases = [_case(name, renderer, motion, device) for name, renderer in renderers.items()]
    for case in cases:
        case.measure(frames[0])
    results = measure_rounds(cases, frames)
    return {name: _facts(taken, plan) for name, taken in results.items()}


def _case(name: str, renderer: ShotRenderer, motion: MovingHand, device: torch.device) -> Case:
    stopwatch = stopwatch_of(device)

    def render(shot: Shot, on_stage: Any) -> Frame:
        def hear(stage: Stage) -> None:
            on_stage(stage)

        return renderer.render(shot, on_stage=hear)

    def measure(frame: MotionFrame) -> Stages:
        return timed_frame(partial(motion.shot, frame), render, stopwatch)[0]

    return Case(name, measure, budget_s=_BUDGET_S)


def _facts(taken: dict[int, Stages], plan: SpeedPlan) -> dict[str, Any]:
    wall_ms, core_s = frame_spread(taken)
    return {
        "size_px": list(plan.size_px),
        "frames": len(taken),
        "ms": round(wall_ms.median, 2),
        "ms_p10": round(wall_ms.p10, 2),
        "ms_p90": round(wall_ms.p90, 2),
        "core_s": round(core_s.median, 4),
        "fps": round(1000 / wall_ms.median, 3),
    }
