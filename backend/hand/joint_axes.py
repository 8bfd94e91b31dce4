"""Anatomical frames of the joints: X is the flexion axis, Y is along the bone, Z points towards the palm.

The built-in hand's are in its file. Another hand's are the rest frames of its bones (`bones.rest_bones`).
"""

from __future__ import annotations

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix
from ..records.side import Side
from .bones import rest_bones
from .gestures import FingerAxes
from .model import HandModel
from .model_file import builtin_sha256, load_default_hand

# Mirrors a frame and then negates its X axis, so that it stays right-handed.
_MIRROR = np.diag([-1.0, 1.0, 1.0])


def joint_frames(model: HandModel) -> np.ndarray:
    """Compute joint frames [16, 3, 3] in the template's, columns X, Y, Z; the wrist has the frame of its bone."""
    frames = rest_bones(model).frames.copy()
    if model.sha256 == builtin_sha256():
        axes = FingerAxes.of_default_hand()
        right = np.stack([axes.flexion, axes.bone, -axes.dorsal], -1)[1:]
        frames[1:] = right if model.side == "right" else _MIRROR @ right @ _MIRROR
    return frames


def finger_axes(model: HandModel) -> FingerAxes:
    """Choose the axes of the angles of gestures, for a right hand."""
    frames = joint_frames(model)
    return FingerAxes(flexion=frames[..., 0], dorsal=-frames[..., 2], bone=frames[..., 1])


def anatomical_axes(model: HandModel) -> np.ndarray:
    """Rotate the built-in hand's flexion, dorsal and bone axes, rows of [15, 3, 3], as a right model's bones differ."""
    axes = FingerAxes.of_default_hand()
    rotation = _shortest_rotations(_bones(load_default_hand()), _bones(model))
    return np.stack([axes.flexion, axes.dorsal, axes.bone], 1)[1:] @ rotation.swapaxes(-1, -2)


def _bones(model: HandModel) -> np.ndarray:
    """Compute unit bones [15, 3] from joint to joint; a finger's last bone continues the one before."""
    along = np.roll(model.joints[1:], -1, 0) - model.joints[1:]
    along[2::3] = along[1::3]
    return along / np.linalg.norm(along, axis=-1, keepdims=True)


def _shortest_rotations(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Compute shortest rotations [N, 3, 3] between unit vectors [N, 3] that are not opposite."""
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), (start * end).sum(-1, keepdims=True)
    return axis_angle_to_matrix(axis / np.where(sine > 0, sine, 1) * np.arctan2(sine, cosine))


def euler_rad(angles_deg: np.ndarray, side: Side) -> np.ndarray:
    """Convert flexion, abduction, twist [..., 3] to X, Y, Z angles [..., 3] rad in a joint's frame (Blender's YZX)."""
    flexion, abduction, twist = np.moveaxis(np.deg2rad(angles_deg), -1, 0)
    sign = 1 if side == "right" else -1
    return np.stack([flexion, sign * twist, -sign * abduction], -1)
