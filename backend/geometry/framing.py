"""A camera whose picture holds what it is to show, and little more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..records.camera import Camera, look_at

DISTANCE_M = 0.75
"""Of the camera from the middle of a hand, as in the captures that avatars learn from."""


def fitting_camera(
    points: np.ndarray, towards_camera: tuple[float, float, float], size_px: tuple[int, int], filled: float
) -> Camera:
    """An upright view (world's Z up) of points, in the middle of the picture.

    Args:
        points: [N, 3] m, world.
        towards_camera: direction from their middle to the camera, not along Z.
        size_px: (width, height).
        filled: share of the picture's width or height, whichever is tighter, that the points take.
    """
    low, high = points.min(0), points.max(0)
    middle, towards = (low + high) / 2, np.array(towards_camera) / np.linalg.norm(towards_camera)
    origin = middle + towards * (DISTANCE_M + np.abs(towards) @ (high - low) / 2)
    unit = Camera(np.eye(3), look_at(origin, middle, np.array([0.0, 0.0, 1.0])), size_px)
    seen, _ = unit.project(points)
    left_top, right_bottom = seen.min(0), seen.max(0)
    focal_px = float((filled * np.array(size_px) / (right_bottom - left_top)).min())
    centre_px = np.array(size_px) / 2 - focal_px * (left_top + right_bottom) / 2
    K = np.array([[focal_px, 0, centre_px[0]], [0, focal_px, centre_px[1]], [0, 0, 1]])
    return replace(unit, K=K)
