"""Parses bone names: the side, finger and phalanx that riggers and formats write into them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..records.side import Side

METACARPAL, INTERPHALANGEAL, TIP = 0.5, 2.5, 9.0
"""Positions along a finger besides 1, 2, 3: of a bone in the palm, of the thumb's last joint where it is named IP, and
of a bone that begins at the fingertip."""

_SIDES: dict[str, Side] = {"right": "right", "r": "right", "left": "left", "l": "left"}
_FINGERS = {
    "thumb": "thumb",
    "index": "index",
    "pointer": "index",
    "middle": "middle",
    "mid": "middle",
    "ring": "ring",
    "pinky": "pinky",
    "pinkie": "pinky",
    "little": "pinky",
}
_PARTS = {
    "metacarpal": METACARPAL,
    "meta": METACARPAL,
    "carpal": METACARPAL,
    "palm": METACARPAL,
    "cmc": METACARPAL,
    "mcp": 1.0,
    "knuckle": 1.0,
    "pip": 2.0,
    "ip": INTERPHALANGEAL,
    "dip": 3.0,
    "proximal": 1.0,
    "prox": 1.0,
    "intermediate": 2.0,
    "inter": 2.0,
    "medial": 2.0,
    "middle": 2.0,
    "distal": 3.0,
    "dist": 3.0,
    "tip": TIP,
    "end": TIP,
    "nub": TIP,
    "null": TIP,
    "leaf": TIP,
}
_LETTERS = {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}
_HANDS = {"hand", "wrist"}
# Words of bones that are not joints of a hand: twists, controls, correctives, props, feet.
_EXCLUDED = set(
    "twist roll correct corrective helper hlp ik fk pole target mch tweak master vis bulge aux drv jiggle pad nail "
    "slide half prop grip weapon attach socket marker toe foot ankle ctrl control parent switch scale share".split()
)
_LAYERS = ("def", "org")
_WORDS = sorted(
    {
        *_FINGERS,
        *_PARTS,
        *_HANDS,
        *(word for word in _SIDES if len(word) > 1),
        "finger",
        "toe",
        "twist",
        "phalanx",
        "root",
    },
    key=len,
    reverse=True,
)
_GLUED = re.compile(f"(?:{'|'.join(_WORDS)})+")
_WORD = re.compile("|".join(_WORDS))
_TOKEN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_COPY = re.compile(r"\.\d{3}$")


@dataclass(frozen=True)
class BoneName:
    """The parts of a bone's name.

    Attributes:
        side: of the body; None if not in the name.
        finger: MANO's name of the finger; None if there is none, or only a number.
        finger_number: where fingers are numbered (`finger2-1`); else None.
        position: along the finger: 1, 2, 3 from the knuckle, `METACARPAL` before, `TIP` behind them; None if not in
            the name. Numbers are given as they are, including 0 and 4.
        is_hand: the bone is the hand or the wrist.
        layer: "def" or "org" for Rigify's bones that repeat the controls; else "".
        is_copy: the name ends in a number that Blender adds to duplicates (`.001`).
    """

    side: Side | None
    finger: str | None
    finger_number: int | None
    position: float | None
    is_hand: bool
    layer: str
    is_copy: bool


def parse_bone_name(name: str) -> BoneName | None:
    """Parse the parts of a name; None if the bone cannot be a joint of a hand, as a twist, a control or a toe."""
    tokens = _tokens(_COPY.sub("", name.rpartition(":")[2]))
    if _EXCLUDED & set(tokens):
        return None
    side: Side | None = next((_SIDES[token] for token in tokens if token in _SIDES), None)
    finger, at = _finger(tokens)
    number, position = None, None
    if finger:
        position = _position(tokens[:at] + tokens[at + 1 :], tokens[at + 1 :])
    elif "finger" in tokens:
        number, position = _numbered_position(tokens[tokens.index("finger") + 1 :])
    is_hand = bool(_HANDS & set(tokens)) and not finger and "finger" not in tokens and _extra(tokens) == 0
    layer = tokens[0] if tokens and tokens[0] in _LAYERS else ""
    return BoneName(side, finger, number, position, is_hand, layer, bool(_COPY.search(name)))


def _tokens(name: str) -> list[str]:
    """Split into lower-case words and numbers; joined words are split if all of them are known."""
    tokens = []
    for token in _TOKEN.findall(name):
        low = token.lower()
        tokens += _WORD.findall(low) if _GLUED.fullmatch(low) else [low]
    return tokens


def _finger(tokens: list[str]) -> tuple[str | None, int]:
    """Find the finger and the index of its token; `middle` beside another finger is the middle phalanx."""
    found = [(token, at) for at, token in enumerate(tokens) if token in _FINGERS]
    if not found:
        return None, -1
    token, at = next((pair for pair in found if pair[0] not in ("middle", "mid")), found[0])
    return _FINGERS[token], at


def _position(others: list[str], following: list[str]) -> float | None:
    """Find the position along a named finger: from a part's name, else from the first number or letter that follows."""
    parts = [1.0 if token == "root" else _PARTS[token] for token in others if token in _PARTS or token == "root"]
    if "in" in others and "hand" in others:  # RightInHandIndex
        return METACARPAL
    if parts:
        return max(parts) if TIP in parts else parts[0]
    numbers = [float(token) for token in following if token.isdigit()]
    letters = [_LETTERS[token] for token in following if token in _LETTERS]
    return (numbers or letters or [None])[0]


def _numbered_position(following: list[str]) -> tuple[int | None, float | None]:
    """Read finger number and position: (2, 1) for `finger2-1` and `finger2`, (2, 2) for `finger21`."""
    numbers = [token for token in following if token.isdigit()]
    parts = [_PARTS[token] for token in following if token in _PARTS]
    if not numbers or len(numbers[0]) > 2:
        return None, None
    if TIP in parts:
        return int(numbers[0][0]), TIP
    if parts:
        return int(numbers[0]), parts[0]
    if len(numbers) >= 2:
        return int(numbers[0]), float(numbers[1])
    return int(numbers[0][0]), float(numbers[0][1:] or 0) + 1


def _extra(tokens: list[str]) -> int:
    """Count the words that make the name one of another bone than the hand."""
    return sum(token in _PARTS or token in ("in", "base") for token in tokens)
