"""Names of hand joints as trackers and data sets spell them: `INDEX_FINGER_MCP`, `thumb-phalanx-distal`, ..."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_FINGERS = {"thumb": 0, "index": 1, "pointer": 1, "middle": 2, "ring": 3, "little": 4, "pinky": 4, "pinkie": 4}
# The place along the thumb and along a finger; 0 is a finger's metacarpal, which MediaPipe has not.
_THUMB = {"cmc": 1, "metacarpal": 1, "knuckle": 1, "mcp": 2, "mp": 2, "proximal": 2, "ip": 3, "distal": 3, "tip": 4}
_FINGER = {
    **{"cmc": 0, "metacarpal": 0, "mcp": 1, "knuckle": 1, "proximal": 1},
    **{"pip": 2, "intermediate": 2, "medial": 2, "dip": 3, "distal": 3, "tip": 4},
}
# Of thumbs whose three bones are named as a finger's, from the metacarpal on.
_THUMB_AS_FINGER = {"metacarpal": 0, "proximal": 1, "knuckle": 1, "intermediate": 2, "medial": 2, "distal": 3, "tip": 4}
_MIDDLE_BONE = {"intermediate", "medial"}
_STARTS, _ENDS = {"start", "prev", "previous", "begin", "base"}, {"end", "next", "tip"}
_OF_PICTURES = {"cmc", "mcp", "mp", "pip", "dip", "ip"}  # anatomical abbreviations: MediaPipe's words
_FILLERS = {
    *("finger", "phalanx", "hand", "joint", "landmark", "landmarks", "xr", "ext", "root", "bone"),
    *("pos", "position", "location", "translation"),
}


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


def read_joint_names(names: Iterable[str]) -> dict[str, JointName]:
    """Find the joints that names of one hand name; those that name none are left out.

    Which joint of the thumb a name means depends on the others; a hand without a wrist has it where the hand begins.
    """
    spelled = {name: words(name) for name in names}
    is_as_finger = any("thumb" in each and _MIDDLE_BONE & set(each) for each in spelled.values())
    found = {name: joint for name, each in spelled.items() if (joint := read_joint_name(each, is_as_finger))}
    if not any(joint.landmark == 0 for joint in found.values()):
        found |= {name: JointName(0) for name, each in spelled.items() if each in (["hand"], ["hand", "position"])}
    return found


def read_joint_name(name_words: list[str], is_thumb_as_finger: bool = False) -> JointName | None:
    """Find the joint that words name; None if they name none or hold any other word.

    Args:
        name_words: in lower case.
        is_thumb_as_finger: the thumb's bones are proximal, intermediate and distal.
    """
    rest = [word for word in name_words if word not in _FILLERS]
    if rest == ["wrist"]:
        return JointName(0)
    if rest == ["palm"]:
        return JointName(None)
    if len(rest) < 2 or rest[0] not in _FINGERS:
        return None
    of_thumb = _THUMB_AS_FINGER if is_thumb_as_finger else _THUMB
    finger, place = _FINGERS[rest[0]], _place(rest[1:], of_thumb if rest[0] == "thumb" else _FINGER)
    if place is None:
        return None
    return JointName(4 * finger + place if place else None, rest[1] in _OF_PICTURES)


def _place(rest: list[str], along: dict[str, int]) -> int | None:
    """Find the place along a finger of a joint's word or number, or of an end of a bone."""
    if rest in (["intermediate", "base"], ["intermediate", "tip"]):  # the joints at the ends of the intermediate bone
        return 2 if rest[1] == "base" else 3
    if len(rest) == 1:
        return int(rest[0]) if rest[0] in "01234" else along.get(rest[0])
    if len(rest) != 2 or rest[0] not in along:
        return None
    return along[rest[0]] if rest[1] in _STARTS else along[rest[0]] + 1 if rest[1] in _ENDS else None
