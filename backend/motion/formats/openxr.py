"""OpenXR joints with orientations as `livehand export` writes them: `rest` makes their rotations exact, twist included.

Files of headsets have no rest pose; `landmarks` reads the joints' places in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle, quaternion_to_axis_angle
from ...hand.model import PARENTS
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

NAME = "OpenXR hand joints, LiveHand"
"""How a file calls its own layout."""
_FOR_PEOPLE = "OpenXR joints with rest pose"
_SHORTEST = 0.5  # of a unit quaternion
_FINGERS = {"INDEX": 1, "MIDDLE": 4, "LITTLE": 7, "RING": 10, "THUMB": 13}
_PARTS, _THUMB_PARTS = ("PROXIMAL", "INTERMEDIATE", "DISTAL"), ("METACARPAL", "PROXIMAL", "DISTAL")
JOINTS = {
    "WRIST": 0,
    **{
        f"{finger}_{part}": first + k
        for finger, first in _FINGERS.items()
        for k, part in enumerate(_THUMB_PARTS if finger == "THUMB" else _PARTS)
    },
}
"""MANO's joints by OpenXR's names of them."""


def full_name(joint: str) -> str:
    """Spell a joint as OpenXR does."""
    return f"XR_HAND_JOINT_{joint}_EXT"


def _matches(document: Document) -> bool:
    return document.entries.get("format") == NAME


def _read(document: Document) -> PoseFile:
    path, entries = document.path, document.entries
    frames, hands = entries.get("frames"), entries.get("hands")
    if not isinstance(frames, list) or not isinstance(hands, dict):
        raise LiveHandError(f"{path} must hold hands and frames, got {document.keys_in_words}; export it again")
    fps = document.array(entries["fps"], "fps", ()).item() if "fps" in entries else None
    found: dict[Side, RawHand] = {side: _hand(document, side, hands[side], frames) for side in SIDES if side in hands}
    return pose_file(path, found, _FOR_PEOPLE, "y_up", has_mean_added=True, fps=fps)


def _hand(document: Document, side: Side, about: Any, frames: Sequence[Any]) -> RawHand:
    if not isinstance(about, Mapping) or "rest" not in about:
        raise LiveHandError(f"{document.path}: the {side} hand must have a rest pose, got none; export it again")
    there = [number for number, frame in enumerate(frames) if isinstance(frame, Mapping) and frame.get(side)]
    if not there:
        raise LiveHandError(f"{document.path}: the {side} hand must be in some frame, got none; export it again")
    posed = _rotations(document, [frames[number][side] for number in there])
    rest = _rotations(document, [about["rest"]])
    turns = posed @ rest.swapaxes(-1, -2)
    of_parents = np.concatenate([np.tile(np.eye(3), (len(turns), 1, 1, 1)), turns[:, list(PARENTS[1:])]], 1)
    theta = matrix_to_axis_angle(of_parents.swapaxes(-1, -2) @ turns)
    wrists = _numbers(document, [frames[number][side] for number in there], "WRIST", "position", 3)
    transl = wrists - _numbers(document, [about["rest"]], "WRIST", "position", 3)
    beta = document.array(about.get("beta", np.zeros(10)), "beta", (10,))
    return raw_hand(theta.reshape(-1, 48), beta, transl, np.array(there))


def _rotations(document: Document, hands: Sequence[Any]) -> np.ndarray:
    """Read [T, 16, 3, 3] orientations of MANO's joints."""
    found = np.empty((len(hands), 16, 4))
    for name, joint in JOINTS.items():
        found[:, joint] = _numbers(document, hands, name, "orientation", 4)
    lengths = np.linalg.norm(found, axis=-1, keepdims=True)
    if (lengths < _SHORTEST).any():
        raise LiveHandError(f"{document.path}: orientations must be unit quaternions, got a shorter one")
    return axis_angle_to_matrix(quaternion_to_axis_angle((found / lengths)[..., [3, 0, 1, 2]]))


def _numbers(document: Document, hands: Sequence[Any], name: str, key: str, count: int) -> np.ndarray:
    """Read [T, count] of one joint."""
    try:
        values = [hand[full_name(name)][key] for hand in hands]
    except (KeyError, TypeError, IndexError) as error:
        raise LiveHandError(
            f"{document.path}: every hand must have {full_name(name)} with {key}, got one without; export it again"
        ) from error
    return document.array(values, f"{key} of {name}", (len(hands), count))


FORMAT = Format(_FOR_PEOPLE, _matches, _read)
