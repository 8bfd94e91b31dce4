"""Configurations taken in turns, frame by frame, so that a noisy neighbour hits all of them alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .cases import frame_cost
from .motion import MotionFrame
from .stopwatch import Spread, Stages, spread

# A configuration that has used up its time still takes this many frames: fewer say nothing of a spread.
_LEAST_FRAMES = 2


@dataclass(frozen=True)
class Case:
    """One thing that is measured in every round.

    Attributes:
        name: of it.
        measure: renders a moment; what each stage took.
        frames: in how many rounds it takes part, spread evenly; None: in all.
        budget_s: it sits out once its frames have taken longer than this.
        is_foreign: it drives everybody else's memory out of the caches, which no stream of frames would meet.
    """

    name: str
    measure: Callable[[MotionFrame], Stages]
    frames: int | None = None
    budget_s: float = float("inf")
    is_foreign: bool = False

    def takes_part(self, number: int, rounds: int, taken: Sequence[Stages]) -> bool:
        """Whether it renders in round `number` of `rounds`, having taken some frames already."""
        if self.frames is not None and not _is_chosen(number, rounds, self.frames):
            return False
        spent_s = sum(frame_cost(stages).wall_ms for stages in taken) / 1000
        return len(taken) < _LEAST_FRAMES or spent_s < self.budget_s


Results = dict[str, dict[int, Stages]]
"""Per case: round -> stages."""


def measure_rounds(cases: Sequence[Case], moments: Sequence[MotionFrame]) -> Results:
    """Every case renders each moment; who begins changes from round to round.

    In a round with a foreign case all others render the moment once more, before the one that counts.
    """
    results: Results = {case.name: {} for case in cases}
    for number, moment in enumerate(moments):
        begin = number % len(cases)
        ring = (*cases[begin:], *cases[:begin])
        chosen = [case for case in ring if case.takes_part(number, len(moments), list(results[case.name].values()))]
        has_foreign = any(case.is_foreign for case in chosen)
        for case in chosen:
            if has_foreign and not case.is_foreign:
                case.measure(moment)
            results[case.name][number] = case.measure(moment)
    return results


def frame_spread(taken: dict[int, Stages]) -> tuple[Spread, Spread]:
    """Wall ms and core-seconds of whole frames."""
    costs = [frame_cost(stages) for stages in taken.values()]
    return spread([cost.wall_ms for cost in costs]), spread([cost.core_s for cost in costs])


def stage_spreads(taken: dict[int, Stages]) -> dict[str, tuple[Spread, Spread]]:
    """Wall ms and core-seconds of every stage."""
    names = dict.fromkeys(name for stages in taken.values() for name in stages)
    by_stage = {name: [stages[name] for stages in taken.values() if name in stages] for name in names}
    return {
        name: (spread([cost.wall_ms for cost in costs]), spread([cost.core_s for cost in costs]))
        for name, costs in by_stage.items()
    }


def paired_ratio(slow: dict[int, Stages], fast: dict[int, Stages]) -> float | None:
    """Median over the rounds both took part in of how many times longer `slow` took; None where there is none."""
    both = slow.keys() & fast.keys()
    if not both:
        return None
    return spread([frame_cost(slow[k]).wall_ms / frame_cost(fast[k]).wall_ms for k in both]).median


def _is_chosen(number: int, rounds: int, count: int) -> bool:
    """`count` of the rounds, evenly: whether this is one."""
    return number * count // rounds != (number - 1) * count // rounds
