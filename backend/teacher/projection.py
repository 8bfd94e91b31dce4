"""Projects vertices onto the hand's surface by Newton steps. Build frame, mm."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from .forearm import STUMP_MM
from .frames import swap_distal
from .rays import Ray
from .sdf import signed_distance

_PROBE = 0.25  # mm, half the base of the central differences
_LEAST_SQUARED_SLOPE = 0.25  # avoids large steps where the gradient is flat, as between two fingers
_LONGEST_STEP = 1.5  # mm


def project_to_surface(
    rays: dict[str, Ray],
    vertices: np.ndarray,
    with_details: bool,
    steps: int,
    damping: float = 1.0,
    forearm_mm: float = STUMP_MM,
) -> np.ndarray:
    """Move vertices [N, 3] along the gradient of the signed distance towards its zero set."""
    distance_at = partial(signed_distance, rays, with_details=with_details, forearm_mm=forearm_mm)
    for _ in range(steps):
        points = swap_distal(vertices)
        distance, slope = distance_at(points), _gradient(distance_at, points)
        squared = np.maximum((slope * slope).sum(1), _LEAST_SQUARED_SLOPE)
        step = np.clip(distance / squared, -_LONGEST_STEP, _LONGEST_STEP)[:, None] * slope
        vertices = vertices - damping * swap_distal(step)
    return vertices


def _gradient(distance_at: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Compute the gradient [N, 3] by central differences, anatomical frame."""
    columns = [
        (distance_at(points + probe) - distance_at(points - probe)) / (2 * _PROBE) for probe in np.eye(3) * _PROBE
    ]
    return np.stack(columns, 1)
