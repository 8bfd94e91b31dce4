"""Signed distances of simple solids: points [N, 3] -> [N], negative inside. Any unit, any frame.

The ellipsoid kinds return the first-order distance (value - 1) / |gradient|, exact on the surface and good near it.
"""

from __future__ import annotations

import numpy as np

from .smooth import unit

_TINY = 1e-9  # avoids 0 / 0 at the centre of a solid


def superellipsoid(
    scaled: tuple[np.ndarray, ...], radii: tuple[np.ndarray | float, ...], exponent: np.ndarray | float
) -> np.ndarray:
    """Measure distance to |x/a|^p + |y/b|^p + |z/c|^p = 1, given coordinates divided by the radii."""
    sizes = [np.abs(coordinate) for coordinate in scaled]
    value = sum(size**exponent for size in sizes) ** (1 / exponent) + _TINY
    slopes = (((size / value) ** (exponent - 1) / radius) ** 2 for size, radius in zip(sizes, radii, strict=True))
    return (value - 1) / (np.sqrt(sum(slopes)) + _TINY)


def ellipsoid(
    points: np.ndarray, ends: tuple[np.ndarray, np.ndarray], up: np.ndarray, side_radius: float, up_radius: float
) -> np.ndarray:
    """Measure distance to an ellipsoid: its long axis between two ends, radii along `up` and sideways across it."""
    centre, axis = (ends[0] + ends[1]) / 2, unit(ends[1] - ends[0])
    half_length = float(np.linalg.norm(ends[1] - ends[0])) / 2
    up = unit(up - axis * (up @ axis))
    offsets = points - centre
    radii = (half_length, side_radius, up_radius)
    directions = (axis, np.cross(axis, up), up)
    scaled = tuple(offsets @ direction / radius for direction, radius in zip(directions, radii, strict=True))
    return superellipsoid(scaled, radii, 2.0)


def capsule(
    points: np.ndarray, start: np.ndarray, end: np.ndarray, start_radius: float, end_radius: float
) -> np.ndarray:
    """Measure distance to a capsule whose radius changes linearly."""
    along = end - start
    t = np.clip((points - start) @ along / (along @ along), 0, 1)
    return np.linalg.norm(points - start - t[:, None] * along, axis=1) - (start_radius * (1 - t) + end_radius * t)


def triangle(points: np.ndarray, corners: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Measure unsigned distance to a triangle; subtract a radius for a rounded plate."""
    a, b, c = corners
    normal = unit(np.cross(b - a, c - a))
    edges = ((a, b), (b, c), (c, a))
    is_over = np.all([(points - p) @ np.cross(normal, q - p) >= 0 for p, q in edges], axis=0)
    to_edges = np.min([_squared_to_segment(points, p, q) for p, q in edges], axis=0)
    return np.sqrt(np.where(is_over, ((points - a) @ normal) ** 2, to_edges))


def ball(points: np.ndarray, centre: np.ndarray, radius: float, stretch: np.ndarray | float = 1.0) -> np.ndarray:
    """Measure distance to a ball; if `stretch` [3] scales it along the axes, in the units of the unscaled ball."""
    return np.linalg.norm((points - centre) / stretch, axis=1) - radius


def _squared_to_segment(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = end - start
    t = np.clip((points - start) @ along / (along @ along), 0, 1)
    return ((points - start - t[:, None] * along) ** 2).sum(1)
