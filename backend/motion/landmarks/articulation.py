"""How a hand can bend: which angles are free, how far they go, and how they go together in natural poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...hand.gestures import sample_angles_deg

# Of each finger joint's flexion, abduction and twist: which are free. Fingers: knuckle both ways, then hinges; thumb:
# its base all ways, then hinges.
_FINGER = ((1, 1, 0), (1, 0, 0), (1, 0, 0))
_THUMB = ((1, 1, 1), (1, 0, 0), (1, 0, 0))
FREE = np.flatnonzero(np.array([_FINGER] * 4 + [_THUMB]).ravel())
"""[21] indices of the free ones among the 45 angles, [5, 3, 3] flattened."""

# Limits, deg. Rest is a slightly bent hand, so the fingers go back beyond 0.
_FINGER_DEG = ((-40, 100), (-30, 30), (-25, 115), (-25, 90))
_THUMB_DEG = ((-40, 60), (-45, 45), (-40, 50), (-30, 75), (-40, 95))
LIMITS = np.deg2rad(np.array(list(_FINGER_DEG) * 4 + list(_THUMB_DEG), float))
"""[21, 2] rad."""

_SAMPLES = 500
# What natural poses may vary beyond our gestures' mixes.
_WIDER, _LOOSE_DEG = 1.6, 8.0


class NaturalPoses(NamedTuple):
    """Natural poses as a normal distribution of the free angles: mean [21] rad, precision [21, 21] rad^-2."""

    mean: np.ndarray
    precision: np.ndarray

    @classmethod
    def of_gestures(cls) -> NaturalPoses:
        """Of mixes of our gestures, made wider."""
        angles = np.deg2rad(sample_angles_deg(np.random.default_rng(0), _SAMPLES)).reshape(_SAMPLES, 45)[:, FREE]
        spread = np.cov(angles.T) * _WIDER**2 + np.eye(len(FREE)) * np.deg2rad(_LOOSE_DEG) ** 2
        return cls(angles.mean(0), np.linalg.inv(spread))


def within_limits(free: np.ndarray) -> np.ndarray:
    """Free angles [..., 21], clipped."""
    return np.clip(free, LIMITS[:, 0], LIMITS[:, 1])


def all_angles(free: np.ndarray) -> np.ndarray:
    """[T, 5, 3, 3] of free angles [T, 21]; the others are zero."""
    angles = np.zeros((len(free), 45))
    angles[:, FREE] = free
    return angles.reshape(-1, 5, 3, 3)


def free_angles(angles: np.ndarray) -> np.ndarray:
    """[T, 21] of angles [T, 5, 3, 3]."""
    return angles.reshape(len(angles), 45)[:, FREE]
