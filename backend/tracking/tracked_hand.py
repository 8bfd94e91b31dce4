"""A hand as the tracker sees it in one picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TrackedHand:
    """A hand in one picture, its landmarks in MediaPipe's order.

    Attributes:
        track: number of the hand; it stays while the hand is not lost.
        px: [21, 2] landmarks in the picture.
        world: [21, 3] m about the hand's centre, in the camera's axes (OpenCV's); an estimate, in depth above all.
        presence: 0..1, how sure the network is that this is a hand.
        right: 0..1, how surely it is a right hand, in a picture that is not mirrored.
    """

    track: int
    px: np.ndarray
    world: np.ndarray
    presence: float
    right: float
