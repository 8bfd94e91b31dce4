"""Anatomical frames of the joints: X is the flexion axis, Y is along the bone, Z points towards the palm.

The built-in hand's are in its file. Another hand's are the rest frames of its bones (`bones.rest_bones`).
"""

from __future__ import annotations

import numpy as np

from ..records.side import Side
from .bones import rest_bones
from .gestures import FingerAxes
from .model import HandModel
from .model_file import builtin_sha256

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


def euler_rad(angles_deg: np.ndarray, side: Side) -> np.ndarray:
    """Convert flexion, abduction, twist [..., 3] to X, Y, Z angles [..., 3] rad in a joint's frame (Blender's YZX)."""
    flexion, abduction, twist = np.moveaxis(np.deg2rad(angles_deg), -1, 0)
    sign = 1 if side == "right" else -1
    return np.stack([flexion, sign * twist, -sign * abduction], -1)
