"""Names of hand joints as trackers and data sets spell them: `INDEX_FINGER_MCP`, `thumb-phalanx-distal`, ..."""

from __future__ import annotations

import re
from typing import NamedTuple

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_FINGERS = {"thumb": 0, "index": 1, "pointer": 1, "middle": 2, "ring": 3, "little": 4, "pinky": 4, "pinkie": 4}
# The place along the thumb and along a finger; 0 is a finger's metacarpal, which MediaPipe has not.
_THUMB = {"cmc": 1, "metacarpal": 1, "knuckle": 1, "mcp": 2, "mp": 2, "proximal": 2, "ip": 3, "distal": 3, "tip": 4}
_FINGER = {
    **{"cmc": 0, "metacarpal": 0, "mcp": 1, "knuckle": 1, "proximal": 1},
    **{"pip": 2, "intermediate": 2, "dip": 3, "distal": 3, "tip": 4},
}
_OF_PICTURES = {"cmc", "mcp", "mp", "pip", "dip", "ip"}  # anatomical abbreviations: MediaPipe's words
_FILLERS = {"finger", "phalanx", "hand", "joint", "landmark", "landmarks", "xr", "ext", "root"}


class JointName(NamedTuple):
    """A joint that was read from its name.

    Attributes:
        landmark: its number among MediaPipe's 21 landmarks; None for a joint that these have not.
        is_anatomical: spelled with MediaPipe's abbreviations (MCP, PIP, ...).
    """

    landmark: int | None
    is_anatomical: bool = False


def words(name: str) -> list[str]:
    """Split a name into words and numbers in lower case: `indexFinger_MCP2` -> index, finger, mcp, 2."""
    return [word.lower() for word in _WORD.findall(name)]


def read_joint_name(name_words: list[str]) -> JointName | None:
    """Find the joint that words name; None if they name none or hold any other word."""
    rest = [word for word in name_words if word not in _FILLERS]
    if rest == ["wrist"]:
        return JointName(0)
    if rest == ["palm"]:
        return JointName(None)
    if len(rest) < 2 or rest[0] not in _FINGERS:
        return None
    finger, place = _FINGERS[rest[0]], _place(rest[1:], _THUMB if rest[0] == "thumb" else _FINGER)
    if place is None:
        return None
    return JointName(4 * finger + place if place else None, rest[1] in _OF_PICTURES)


def _place(rest: list[str], picture_points: dict[str, int]) -> int | None:
    if rest == ["intermediate", "base"]:  # the joints at the ends of the intermediate bone
        return 2
    if rest == ["intermediate", "tip"]:
        return 3
    return picture_points.get(rest[0]) if len(rest) == 1 else None
