"""The built-in hand's own file: the arrays that `HandModel` does not carry. Needs numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model_file import default_hand_path


@dataclass(frozen=True)
class BuiltinExtras:
    """Arrays of the built-in hand beyond MANO's keys, template frame; rows of joint 0 are zero.

    Attributes:
        flex_axis: [16, 3] unit; a positive rotation about it flexes the joint.
        bone_dir: [16, 3] unit, from the joint along its bone.
        dorsal_dir: [16, 3] unit, towards the back of the hand, orthogonal to the bone.
        joints: [16, 3] m, as designed (`J_regressor @ v_template` meets them within 0.01 mm).
        quads: [1270, 4] vertex indices: the triangles of `f` before they were split.
    """

    flex_axis: np.ndarray
    bone_dir: np.ndarray
    dorsal_dir: np.ndarray
    joints: np.ndarray
    quads: np.ndarray


def read_extras() -> BuiltinExtras:
    """Read the extra arrays of the shipped hand."""
    with np.load(default_hand_path(), allow_pickle=False) as archive:
        names = ("flex_axis", "bone_dir", "dorsal_dir", "J", "quads")
        return BuiltinExtras(*(archive[name] for name in names))
