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


_SAME_HAND = 0.12  # mean distance of landmarks from another hand's nearest, as a share of the larger hand


def is_same_hand(px: np.ndarray, other_px: np.ndarray) -> bool:
    """Tell whether landmarks [21, 2] and others lie on one hand of a picture, whatever finger each is taken for.

    Two hands that touch, or that cover each other by half, are farther apart.
    """
    apart_px = np.linalg.norm(px[:, None] - other_px, axis=-1)
    size_px = max(np.ptp(px, axis=0).max(), np.ptp(other_px, axis=0).max(), 1e-9)
    return bool((apart_px.min(0).mean() + apart_px.min(1).mean()) / 2 < _SAME_HAND * size_px)
