"""How far a motion bends a hand's joints beyond what hands can do: it tells a misread rig from a read one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ..hand.joint_limits import FREE, LIMITS
from ..hand.model import JOINT_NAMES, MIRROR_AXIS_ANGLE, PARENTS, HandModel
from ..motion.landmarks.skeleton import HandSkeleton
from ..motion.motion import HandMotion
from .rest_alignment import RestAlignment

_HINGE_RAD = np.deg2rad(30.0)  # of the angles that are not free: sideways and about the bone
_UNNATURAL_RAD = np.deg2rad(20.0)  # beyond the limits, which are wide
_SOME_FRAMES = 0.05  # share of a motion's frames
_LESS = 0.5  # of the excess, at which another reading of the motion is better


def excess_rad(model: HandModel, theta: np.ndarray) -> np.ndarray:
    """Compute [T, 15] how far each finger joint of poses theta [T, 16, 3] is beyond its limits, by its worst angle."""
    right = theta if model.side == "right" else theta * MIRROR_AXIS_ANGLE
    axes = HandSkeleton.of(model).axes.reshape(15, 3, 3)
    frames = np.stack([axes[:, 0], axes[:, 2], -axes[:, 1]], -1)  # columns: flexion axis, bone, palm
    local = frames.swapaxes(1, 2) @ axis_angle_to_matrix(right[:, 1:]) @ frames
    flexion = np.arctan2(local[..., 2, 1], local[..., 1, 1])
    abduction = np.arcsin(np.clip(local[..., 0, 1], -1, 1))
    twist = np.arctan2(local[..., 0, 2], local[..., 0, 0])
    angles = np.stack([flexion, abduction, twist], -1)  # [T, 15, 3]
    return np.maximum(_LIMITS_RAD[..., 0] - angles, angles - _LIMITS_RAD[..., 1]).max(-1).clip(min=0)


def rest_pose(alignment: RestAlignment) -> HandMotion:
    """Find the pose that our hand has where the other rig is at rest, as a motion of one frame without a place."""
    theta = local_theta(alignment.rotations[None])
    return HandMotion(theta, alignment.shape.beta, np.zeros((1, 3)), None, alignment.model.side)


def local_theta(rotations: np.ndarray) -> np.ndarray:
    """Compute theta [T, 16, 3] of the joints' rotations in the world [T, 16, 3, 3]."""
    above = np.concatenate([np.tile(np.eye(3), (len(rotations), 1, 1, 1)), rotations[:, list(PARENTS[1:])]], 1)
    return matrix_to_axis_angle(above.swapaxes(2, 3) @ rotations)


def unnatural_joints(model: HandModel, motion: HandMotion) -> str | None:
    """Word which joints a motion bends beyond what a hand can do; None if there are none."""
    excess = excess_rad(model.for_side(motion.side), motion.theta)
    is_beyond = _is_beyond(excess)
    if not is_beyond.any():
        return None
    names = [name for name, beyond in zip(JOINT_NAMES[1:], is_beyond, strict=True) if beyond]
    return f"{', '.join(names)} bend up to {np.rad2deg(excess.max()):.0f} degrees beyond what a hand can"


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


def _limits_rad() -> np.ndarray:
    """Return [15, 3, 2] smallest and largest flexion, abduction and twist."""
    limits = np.tile([-_HINGE_RAD, _HINGE_RAD], (45, 1))
    limits[FREE] = LIMITS
    return limits.reshape(15, 3, 2)


_LIMITS_RAD = _limits_rad()
