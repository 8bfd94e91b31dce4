"""Leap Motion's hands: bones with both ends in each finger, or, in its JavaScript, joints of a frame's pointables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...records.side import Side

_FINGERS, _START, _END = ("fingers", "digits"), ("prevjoint", "prev"), ("nextjoint", "next")
_WRIST = ("wristposition", "wrist")
_OF_POINTABLES = ("mcpposition", "pipposition", "dipposition", "btipposition")


class BonyHand(NamedTuple):
    """A hand's points [21, 3] in MediaPipe's order, and its side, if the file says it."""

    points: np.ndarray
    side: Side | None


def hand_points(entries: Mapping[str, Any]) -> BonyHand | None:
    """Read a hand with plain keys; None if it is none of Leap's.

    Raises:
        ValueError, TypeError, KeyError: it is, and it is malformed.
    """
    fingers = next((entries[key] for key in _FINGERS if key in entries), None)
    if not isinstance(fingers, list) or len(fingers) != 5 or not all(isinstance(one, Mapping) for one in fingers):
        return None
    plain = sorted((_plain(finger) for finger in fingers), key=lambda finger: _number(finger.get("type")))
    chains = [_chain(finger) for finger in plain]
    if any(chain is None for chain in chains):
        return None
    wrist = next((entries[key] for key in _WRIST if entries.get(key) is not None), None)
    if wrist is None:
        wrist = _plain(plain[1]["bones"][0])[_START[0]] if "bones" in plain[1] else plain[1]["carpposition"]
    joints = [_point(wrist), *(point for chain in chains for point in chain or ())]
    return BonyHand(np.array(joints, float), _side(entries))


def with_fingers(frame: Mapping[str, Any]) -> Mapping[str, Any]:
    """Give the hands of a frame of Leap's JavaScript their fingers, which it lists beside them; else the frame."""
    hands, pointables = frame.get("hands"), frame.get("pointables")
    if not isinstance(hands, list) or not isinstance(pointables, list):
        return frame
    fingers = [one for one in pointables if isinstance(one, Mapping) and not one.get("tool")]
    whole = [
        {**hand, "fingers": [one for one in fingers if one.get("handId") == hand.get("id")]}
        for hand in hands
        if isinstance(hand, Mapping)
    ]
    return {"hands": whole}


def _chain(finger: Mapping[str, Any]) -> list[list[float]] | None:
    """Read the three joints and the tip of a finger or a thumb, whose metacarpal has no length."""
    if all(key in finger for key in _OF_POINTABLES):
        return [_point(finger[key]) for key in _OF_POINTABLES]
    bones = finger.get("bones")
    if not isinstance(bones, list) or len(bones) != 4:
        return None
    ends = [_plain(bone) for bone in bones[1:]]
    start = next((key for key in _START if all(key in bone for bone in ends)), None)
    end = next((key for key in _END if key in ends[-1]), None)
    if start is None or end is None:
        return None
    return [*(_point(bone[start]) for bone in ends), _point(ends[-1][end])]


def _side(entries: Mapping[str, Any]) -> Side | None:
    is_left = entries.get("isleft")
    if isinstance(is_left, bool):
        return "left" if is_left else "right"
    text = str(next((entries[key] for key in ("type", "handtype", "chirality") if key in entries), "")).lower()
    return "left" if text == "left" else "right" if text == "right" else None


def _point(value: Any) -> list[float]:
    if isinstance(value, Mapping):
        return [float(value[axis]) for axis in "xyz"]
    x, y, z = value
    return [float(x), float(y), float(z)]


def _number(value: Any) -> int:
    """Find a finger's number, from the thumb on; 0 for all leaves them in their order."""
    return int(value) if isinstance(value, int | float) and 0 <= value <= 4 else 0


def _plain(entries: Mapping[str, Any]) -> dict[str, Any]:
    return {re.sub(r"[^a-z0-9]", "", str(key).lower()): value for key, value in entries.items()}
