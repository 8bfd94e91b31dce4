"""How far a view looks past the cameras of training: the angle between their directions, seen from the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..captures.capture import Capture, CaptureView


def train_view_angle_deg(
    origin: Float[np.ndarray, 3], train_origins: Float[np.ndarray, "T 3"], hand_centre: Float[np.ndarray, 3]
) -> float:
    """Angle at the hand's centre between a camera and the nearest of the training cameras, degrees; NaN without any.

    All in the world, m. Distances do not count: a close-up along a training camera's ray has no gap.
    """
    if not len(train_origins):
        return float("nan")
    direction, known = _unit(origin - hand_centre), _unit(train_origins - hand_centre)
    nearest = known[(known @ direction).argmax()]
    # Half-angle by the chord: arccos would lose small angles.
    return float(np.degrees(2 * np.arcsin(min(np.linalg.norm(direction - nearest) / 2, 1.0))))


def train_origins(capture: Capture) -> Float[np.ndarray, "T 3"]:
    """Where the cameras of the training images stand, each place once, world, m."""
    origins = {tuple(view.camera.origin.round(6)) for view in capture.of_split("train")}
    return np.array(sorted(origins)).reshape(-1, 3)


def train_view_angles_deg(
    capture: Capture, views: Sequence[CaptureView], hand_centres: Float[np.ndarray, "P 3"]
) -> list[float]:
    """The gap of each view, degrees; `hand_centres` by pose."""
    known = train_origins(capture)
    return [train_view_angle_deg(view.camera.origin, known, hand_centres[view.pose_index]) for view in views]


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
