"""Configurations measured in turns, frame by frame, so that other load on the machine affects all of them alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .cases import frame_cost
from .motion import MotionFrame
from .stopwatch import Spread, Stages, spread

_MIN_FRAMES = 2
"""Frames that a case renders even when its budget is used up: one frame has no spread."""


@dataclass(frozen=True)
class Case:
    """One thing that is measured in every round.

    Attributes:
        name: of the case.
        measure: renders a frame of the motion and returns the cost of each stage.
        frames: in how many rounds the case takes part, spread evenly; None: in all.
        budget_s: the case sits out once its frames have taken longer than this.
        evicts_caches: it clears the processor's caches of all other cases' data, which a stream of frames never does.
    """

    name: str
    measure: Callable[[MotionFrame], Stages]
    frames: int | None = None
    budget_s: float = float("inf")
    evicts_caches: bool = False

    def takes_part(self, number: int, rounds: int, taken: Sequence[Stages]) -> bool:
        """Tell whether the case renders in round `number` of `rounds`, given the frames it has rendered so far."""
        if self.frames is not None and number * self.frames // rounds == (number - 1) * self.frames // rounds:
            return False
        spent_s = sum(frame_cost(stages).wall_ms for stages in taken) / 1000
        return len(taken) < _MIN_FRAMES or spent_s < self.budget_s


Results = dict[str, dict[int, Stages]]
"""Per case: round -> stages."""


def measure_rounds(cases: Sequence[Case], frames: Sequence[MotionFrame]) -> Results:
    """Measure rounds: every case renders each frame; another case begins in each round.

    In a round with a case that evicts caches, every other case renders the frame once more before it is timed.
    """
    results: Results = {case.name: {} for case in cases}
    for number, frame in enumerate(frames):
        begin = number % len(cases)
        ring = (*cases[begin:], *cases[:begin])
        chosen = [case for case in ring if case.takes_part(number, len(frames), list(results[case.name].values()))]
        is_cold = any(case.evicts_caches for case in chosen)
        for case in chosen:
            if is_cold and not case.evicts_caches:
                case.measure(frame)
            results[case.name][number] = case.measure(frame)
    return results


def frame_spread(taken: dict[int, Stages]) -> tuple[Spread, Spread]:
    """Collect wall ms and core-seconds of whole frames."""
    costs = [frame_cost(stages) for stages in taken.values()]
    return spread([cost.wall_ms for cost in costs]), spread([cost.core_s for cost in costs])


def stage_spreads(taken: dict[int, Stages]) -> dict[str, tuple[Spread, Spread]]:
    """Collect wall ms and core-seconds of every stage."""
    names = dict.fromkeys(name for stages in taken.values() for name in stages)
    by_stage = {name: [stages[name] for stages in taken.values() if name in stages] for name in names}
    return {
        name: (spread([cost.wall_ms for cost in costs]), spread([cost.core_s for cost in costs]))
        for name, costs in by_stage.items()
    }


def paired_ratio(slow: dict[int, Stages], fast: dict[int, Stages]) -> float | None:
    """Take the median over shared rounds of how many times longer `slow` took; None where they share no round."""
    both = slow.keys() & fast.keys()
    if not both:
        return None
    return spread([frame_cost(slow[k]).wall_ms / frame_cost(fast[k]).wall_ms for k in both]).median
