"""A look at a film before it is tracked: whether its hand turns at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...records.errors import LiveHandError
from ..tracked_hand import TrackedHand

if TYPE_CHECKING:
    from ..still import StillTracker
    from ..video import DecodedFrame

_SAMPLES, _LEAST_SEEN = 8, 4
_STILL = 0.05  # of a hand's size: the world landmarks of a turn by 3 degrees differ so much, and a tracker's noise less


def check_hand_turns(frames: Iterable[DecodedFrame], count: int, tracker: StillTracker) -> None:
    """Raise LiveHandError if the hand is in one pose, seen from one side, in frames spread over a film of so many."""
    wanted = set(np.linspace(0, max(count - 1, 0), _SAMPLES).astype(int).tolist())
    found = [tracker.hands(frame.picture()) for index, frame in enumerate(frames) if index in wanted]
    change = largest_change([hands[0] for hands in found if hands])
    if change is not None and change < _STILL:
        raise LiveHandError(
            f"a capture needs a hand that turns, got a still one (joints move by {change:.1%} of its size): "
            "at most half of its skin is seen; turn it slowly before the camera, for half a minute"
        )


def largest_change(hands: Sequence[TrackedHand]) -> float | None:
    """Compute by how much world landmarks differ at most, root mean square over a hand's size; None: too few hands."""
    if len(hands) < _LEAST_SEEN:
        return None
    world = np.stack([hand.world - hand.world.mean(0) for hand in hands])
    size = np.median(np.ptp(world, axis=1).max(-1))
    off = world[:, None] - world
    return float(np.sqrt((off**2).sum(-1).mean(-1)).max() / size)
