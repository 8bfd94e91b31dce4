"""The hands of single photographs: every view is tried at once, for no other picture will come."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jaxtyping import UInt8

from .palm_search import other_views
from .tracked_hand import TrackedHand

if TYPE_CHECKING:
    import numpy as np

    from .tracker import HandTracker

_LOOKS = 3  # at each hand, from where it was seen before


def hands_of_still(picture: UInt8[np.ndarray, "H W 3"], tracker: HandTracker) -> list[TrackedHand]:
    """Find the hands in one photograph, sRGB, whatever the tracker followed before; none after all views.

    Raises:
        LiveHandError: the picture is empty.
    """
    tracker.forget()
    for _ in other_views(picture):
        hands = tracker.track(picture)
        if hands:
            break
    else:
        return []
    for _ in range(_LOOKS - 1):
        hands = tracker.track(picture) or hands
    return hands
