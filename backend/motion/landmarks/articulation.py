"""How hands bend: their free joint angles in natural poses."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ...hand.gestures import sample_angles_deg
from ...hand.joint_limits import FREE, LIMITS
from ...hand.poses import POSES

_SAMPLES = 500
# How much natural poses vary beyond mixes of the built-in gestures: a factor, and degrees per angle.
_SPREAD_FACTOR, _EXTRA_SPREAD_DEG = 1.6, 8.0
_LIBRARY_SPREAD_DEG = 5.0


class NaturalPoses(NamedTuple):
    """A normal distribution of the free angles: mean [21] rad, precision [21, 21] rad^-2."""

    mean: np.ndarray
    precision: np.ndarray

    @classmethod
    @cache
    def of_gestures(cls) -> NaturalPoses:
        """Fit the distribution of mixes of the built-in gestures, widened."""
        angles = np.deg2rad(sample_angles_deg(np.random.default_rng(0), _SAMPLES)).reshape(_SAMPLES, 45)[:, FREE]
        spread = np.cov(angles.T) * _SPREAD_FACTOR**2 + np.eye(len(FREE)) * np.deg2rad(_EXTRA_SPREAD_DEG) ** 2
        return cls(angles.mean(0), np.linalg.inv(spread))

    @classmethod
    @cache
    def of_library(cls) -> NaturalPoses:
        """Fit the distribution of the same mixes and, as often, of the pose library, less widened."""
        mixes = sample_angles_deg(np.random.default_rng(0), _SAMPLES).reshape(_SAMPLES, 45)[:, FREE]
        library = np.stack([pose.gesture.angles_deg() for pose in POSES.values()]).reshape(-1, 45)[:, FREE]
        both = np.deg2rad(np.concatenate([mixes, np.repeat(library, _SAMPLES // len(library), 0)]))
        spread = np.cov(both.T) + np.eye(len(FREE)) * np.deg2rad(_LIBRARY_SPREAD_DEG) ** 2
        return cls(both.mean(0), np.linalg.inv(spread))


def within_limits(free: np.ndarray) -> np.ndarray:
    """Free angles [..., 21] clipped to their limits."""
    return np.clip(free, LIMITS[:, 0], LIMITS[:, 1])


def all_angles(free: np.ndarray) -> np.ndarray:
    """Fill in all angles [T, 5, 3, 3] from the free ones [T, 21]; the others are zero."""
    angles = np.zeros((len(free), 45))
    angles[:, FREE] = free
    return angles.reshape(-1, 5, 3, 3)


def free_angles(angles: np.ndarray) -> np.ndarray:
    """Select the free angles [T, 21] among all angles [T, 5, 3, 3]."""
    return angles.reshape(len(angles), 45)[:, FREE]
