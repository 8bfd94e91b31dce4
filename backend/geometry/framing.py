"""A camera that frames given points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..records.camera import Camera, look_at

DISTANCE_M = 0.75
"""Distance from the camera to the centre of a hand, as in the captures that avatars are trained on."""


def fitting_camera(
    points: np.ndarray, towards_camera: tuple[float, float, float], size_px: tuple[int, int], filled: float
) -> Camera:
    """Fit an upright view (world Z up) with the points in the middle of the image.

    Args:
        points: [N, 3] m, world.
        towards_camera: direction from their centre to the camera, not along Z.
        size_px: (width, height).
        filled: share of the image that the points fill, of its width or height, whichever is tighter.
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
