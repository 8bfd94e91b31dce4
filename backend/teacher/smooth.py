"""Smooth steps, bumps and unions on arrays, from which the hand's surface is composed."""

from __future__ import annotations

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Scale vectors [..., 3] to length 1. A zero vector gives NaN."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def smooth_min(a: np.ndarray, b: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """Blend min(a, b) by a polynomial: itself where they differ by more than `radius`, else at most radius / 4 below.

    Inigo Quilez, "smooth minimum", quadratic polynomial.
    """
    share = np.clip(0.5 + 0.5 * (b - a) / radius, 0, 1)
    return b * (1 - share) + a * share - radius * share * (1 - share)


def smooth_max(a: np.ndarray, b: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """Smooth maximum, as `smooth_min`."""
    return -smooth_min(-a, -b, radius)


def smoothstep(x: np.ndarray, start: float | int, end: float | int) -> np.ndarray:
    """Rise from 0 at `start` to 1 at `end`, flat outside; fall where start > end."""
    t = np.clip((x - start) / (end - start), 0, 1)
    return t * t * (3 - 2 * t)


def bump(x: np.ndarray, width: float | int) -> np.ndarray:
    """Evaluate a Gaussian of height 1 and standard deviation `width`."""
    return np.exp(-0.5 * (x / width) ** 2)
