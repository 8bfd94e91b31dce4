"""The coordinate systems of pose files, and rigid transforms of motions between them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ..hand.model import HandModel
from .motion import HandMotion

Space = Literal["hand", "z_up", "y_up", "opencv", "opengl"]
"""`hand`: the armature's own space; `z_up`: Blender's world; `y_up`: a world that looks along -Z; `opencv`: a camera
with x right, y down, z forward; `opengl`: a camera with x right, y up, z back."""
SPACES: tuple[Space, ...] = get_args(Space)

_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
TO_BLENDER: dict[Space, np.ndarray] = {
    "hand": np.eye(3),
    "z_up": np.eye(3),
    "y_up": _Y_UP,
    "opencv": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "opengl": _Y_UP,
}
"""[3, 3] from each space to Blender's world, in which a camera looks along +Y."""


def rest_wrists(model: HandModel, beta: np.ndarray) -> np.ndarray:
    """Return [..., 3] m: the wrist joint, about which the root rotates, of shapes [..., 10] in the template's frame."""
    return model.joints[0] + np.einsum("v,vck,...k->...c", model.J_regressor[0], model.shapedirs, beta)


def transformed(motion: HandMotion, matrix: np.ndarray, wrists: np.ndarray) -> HandMotion:
    """Transform the motion by an affine map. A scale applies to the wrist's position, not to the hand's size.

    Args:
        motion: of T frames.
        matrix: [4, 4] from the motion's present space to the new one, or [T, 4, 4].
        wrists: [T, 3] or [3] m, `rest_wrists` of its shape: theta rotates about them, so transl depends on them.
    """
    linear = matrix[..., :3, :3]
    rotation = linear / np.linalg.norm(linear, axis=-2, keepdims=True)
    theta = motion.theta.copy()
    theta[:, 0] = matrix_to_axis_angle(rotation @ axis_angle_to_matrix(motion.theta[:, 0]))
    transl = (linear @ (wrists + motion.transl)[..., None])[..., 0] + matrix[..., :3, 3] - wrists
    return replace(motion, theta=theta, transl=transl)


def to_blender(space: Space) -> np.ndarray:
    """Look up the transform [4, 4] from a file's space to Blender's world."""
    matrix = np.eye(4)
    matrix[:3, :3] = TO_BLENDER[space]
    return matrix
