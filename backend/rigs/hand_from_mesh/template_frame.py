"""The transform of a hand into the template's frame: fingers -X, back of the hand +Y, thumb +Z (right hand)."""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import rotation_between
from ...hand.model import MIRROR_POINT
from ...hand.model_file import load_default_hand
from ...records.errors import LiveHandError
from ...records.side import Side

_KNUCKLES = [1, 4, 7, 10]
_LAST_JOINTS = [3, 6, 9, 12]
_THUMB_TIP = 15
SMALLEST_M, LARGEST_M = 0.1, 0.3  # from the wrist to the middle fingertip
# Fingers that bend backwards by more than this share of the hand's length show that the side is wrong.
_MOST_BACKWARDS = 0.06


def world2template(joints: np.ndarray, side: Side) -> np.ndarray:
    """Fit the rigid transform [4, 4] from the world of the joints [16, 3] m to the template's frame.

    The wrist is moved to the built-in hand's, then the knuckles are aligned with its knuckles by rotation (Kabsch).

    Raises:
        LiveHandError: the joints have the wrong size, or seem to be those of the other side.
    """
    builtin = load_default_hand().joints * (1 if side == "right" else MIRROR_POINT)
    check_size(joints)
    knuckles, wanted = joints[_KNUCKLES] - joints[0], builtin[_KNUCKLES] - builtin[0]
    rotation = rotation_between(knuckles, wanted)
    _check_side((joints - joints[0]) @ rotation.T, side)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, builtin[0] - rotation @ joints[0]
    return matrix


def hand_length_m(joints: np.ndarray) -> float:
    """Measure from the wrist along the middle finger to its tip, taken to be a last bone beyond the last joint."""
    steps = np.linalg.norm(np.diff(joints[[0, 4, 5, 6]], axis=0), axis=1)
    return float(steps.sum() + steps[-1])


def check_size(joints: np.ndarray) -> None:
    """Raise `LiveHandError` unless the joints have the size of a hand in metres; the message suggests a unit."""
    length = hand_length_m(joints)
    if SMALLEST_M <= length <= LARGEST_M:
        return
    units = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254, "decimetres": 0.1}
    fitting = [(unit, scale) for unit, scale in units.items() if SMALLEST_M <= length * scale <= LARGEST_M]
    guess = f"it seems to be in {fitting[0][0]}: scale it by {fitting[0][1]:g}" if fitting else "scale it"
    raise LiveHandError(
        f"a hand must be {SMALLEST_M} to {LARGEST_M} m long from wrist to middle fingertip, got {length:.3g} m; {guess}"
    )


def _check_side(joints: np.ndarray, side: Side) -> None:
    """Raise `LiveHandError` if the resting fingers bend backwards."""
    length = hand_length_m(joints)
    backwards = joints[_LAST_JOINTS, 1].mean() + joints[_THUMB_TIP, 1]  # +Y is the back of either hand
    if backwards > _MOST_BACKWARDS * length:
        other = "left" if side == "right" else "right"
        raise LiveHandError(
            f"a resting hand's fingers must bend towards its palm; these are bent {1e3 * backwards:.0f} mm backwards "
            f"as a {side} hand's: choose the {other} side, or correct the order of its fingers"
        )
