"""The train-view angle: between the directions, seen from the hand, to a camera and to the nearest training camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..capture.capture import Capture, CaptureView


def train_view_angle_deg(
    origin: Float[np.ndarray, 3], train_origins: Float[np.ndarray, "T 3"], hand_centre: Float[np.ndarray, 3]
) -> float:
    """Measure the angle, degrees, at the hand's centre between a camera and the nearest training one; NaN without any.

    Positions are in world space, m. Distance does not count: a close-up along a training camera's axis has angle 0.
    """
    if not len(train_origins):
        return float("nan")
    direction, known = _unit(origin - hand_centre), _unit(train_origins - hand_centre)
    nearest = known[(known @ direction).argmax()]
    # From the chord, because arccos is imprecise at small angles.
    return float(np.degrees(2 * np.arcsin(min(np.linalg.norm(direction - nearest) / 2, 1.0))))


def train_origins(capture: Capture) -> Float[np.ndarray, "T 3"]:
    """List positions of the cameras of the training images, without duplicates, world, m."""
    origins = {tuple(view.camera.origin.round(6)) for view in capture.of_split("train")}
    return np.array(sorted(origins)).reshape(-1, 3)


def train_view_angles_deg(
    capture: Capture, views: Sequence[CaptureView], hand_centres: Float[np.ndarray, "P 3"]
) -> list[float]:
    """Measure the train-view angle of each view, degrees; `hand_centres` are indexed by pose."""
    known = train_origins(capture)
    return [train_view_angle_deg(view.camera.origin, known, hand_centres[view.pose_index]) for view in views]


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
