"""Whether a hand can have the poses that a rig leads to: it tells a misread rig from a read one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..geometry.rotation import matrix_to_axis_angle
from ..hand.model import PARENTS, HandModel
from ..motion.gate import excess_rad
from ..motion.motion import HandMotion
from .rest_alignment import RestAlignment

_UNNATURAL_RAD = np.deg2rad(20.0)  # beyond the limits, which are wide
_SOME_FRAMES = 0.05  # share of a motion's frames
_LESS = 0.5  # of the excess, at which another reading of the motion is better


def rest_pose(alignment: RestAlignment) -> HandMotion:
    """Find the pose that our hand has where the other rig is at rest, as a motion of one frame without a place."""
    theta = local_theta(alignment.rotations[None])
    return HandMotion(theta, alignment.shape.beta, np.zeros((1, 3)), None, alignment.model.side)


def local_theta(rotations: np.ndarray) -> np.ndarray:
    """Compute theta [T, 16, 3] of the joints' rotations in the world [T, 16, 3, 3]."""
    above = np.concatenate([np.tile(np.eye(3), (len(rotations), 1, 1, 1)), rotations[:, list(PARENTS[1:])]], 1)
    return matrix_to_axis_angle(above.swapaxes(2, 3) @ rotations)


def is_natural(model: HandModel, motion: HandMotion) -> bool:
    """Tell whether a hand can have the poses of a motion, but for a few frames."""
    return not _is_beyond(excess_rad(model.for_side(motion.side), motion.theta)).any()


def more_natural(model: HandModel, motion: HandMotion, other: Callable[[], HandMotion]) -> HandMotion:
    """Choose a motion, or the other one if the first is beyond a hand's limits and the other far less so."""
    excess = excess_rad(model, motion.theta)
    if not _is_beyond(excess).any():
        return motion
    second = other()
    return second if excess_rad(model, second.theta).mean() < _LESS * excess.mean() else motion


def _is_beyond(excess: np.ndarray) -> np.ndarray:
    """Return [15] bool: joints that are clearly beyond their limits in more than a few frames."""
    return (excess > _UNNATURAL_RAD).mean(0) > _SOME_FRAMES
