"""What every writer takes: one or both hands of a take, in Blender's world, with the model that plays each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...records.side import Side
from ..motion import HandMotion
from ..spaces import Space, rest_wrists, to_blender, transformed


@dataclass(frozen=True)
class TakenHand:
    """One hand of a take.

    Attributes:
        motion: absolute, m, in Blender's world (Z up).
        model: of either side; the motion's side is used.
        scale: of the hand in the world against its model.
        first: the frame of the take, from 0, at which the motion begins.
        own: the motion in the hand's own space; None: that is the world.
    """

    motion: HandMotion
    model: HandModel
    scale: float = 1.0
    first: int = 0
    own: HandMotion | None = None

    @property
    def side(self) -> Side:
        """Which hand it is."""
        return self.motion.side

    @property
    def own_model(self) -> HandModel:
        """The model of this hand's side."""
        return self.model.for_side(self.side)

    @property
    def frames(self) -> np.ndarray:
        """[T] frames of the take, from 0."""
        return self.first + np.arange(len(self.motion))

    def motion_in(self, space: Space) -> HandMotion:
        """Return the motion in another space."""
        return moved(self.motion, self.own_model, np.linalg.inv(to_blender(space)))

    def held(self, count: int) -> TakenHand:
        """Return the hand over all frames of a take of this length: it holds still before it comes and once it ends."""
        index = np.clip(np.arange(count) - self.first, 0, len(self.motion) - 1)
        motion = self.motion
        held = replace(
            motion,
            theta=motion.theta[index],
            transl=motion.transl[index],
            beta=motion.beta if motion.beta.ndim == 1 else motion.beta[index],
            forearm=motion.forearm if motion.forearm.ndim == 1 else motion.forearm[index],
        )
        return replace(self, motion=held, first=0)


@dataclass(frozen=True)
class Take:
    """The hands of a take.

    Attributes:
        hands: at most one of each side, the right one first.
        fps: frames per second of all of them.

    Raises:
        LiveHandError: there is no hand, or two of one side.
    """

    hands: tuple[TakenHand, ...]
    fps: float

    def __post_init__(self):
        sides = [hand.side for hand in self.hands]
        if not sides or len(set(sides)) < len(sides):
            got = " and ".join(sides) or "none"
            raise LiveHandError(f"an export must have one hand, or a right and a left one, got {got}; choose --side")

    @property
    def count(self) -> int:
        """Frames from the take's first to the last that has a hand."""
        return max(hand.first + len(hand.motion) for hand in self.hands)

    @property
    def times_s(self) -> np.ndarray:
        """[count] seconds of each frame since the first."""
        return np.arange(self.count) / self.fps

    def only(self, format_name: str) -> TakenHand:
        """Return the only hand, for a format that holds one.

        Raises:
            LiveHandError: there are two.
        """
        if len(self.hands) > 1:
            raise LiveHandError(
                f"a file in {format_name} holds one hand, got right and left; choose one (--side), and write two files"
            )
        return next(iter(self.hands))


def take_of(hands: Sequence[TakenHand], fps: float) -> Take:
    """Join hands to a take, the right one first.

    Raises:
        LiveHandError: as `Take`.
    """
    return Take(tuple(sorted(hands, key=lambda hand: hand.side, reverse=True)), fps)


def moved(motion: HandMotion, model: HandModel, matrix: np.ndarray) -> HandMotion:
    """Transform a motion by [4, 4]; a scale applies to the wrist's place, see `transformed`."""
    return transformed(motion, matrix, rest_wrists(model.for_side(motion.side), motion.betas))
