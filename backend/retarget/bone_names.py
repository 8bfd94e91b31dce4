"""What a bone's name says: side, finger, which part of it; the words that riggers and formats use."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..records.shot import Side

METACARPAL, TIP = 0.5, 9.0
"""Places along a finger beside 1, 2, 3: of a bone within the palm, and of a bone that begins at the fingertip."""

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
# Bones that carry no joint: twists, controls, correctives, and what is no hand's.
_OTHERS = set(
    "twist roll correct corrective helper hlp ik fk pole target mch tweak master vis bulge aux drv jiggle pad nail "
    "slide half prop grip weapon attach socket marker toe foot ankle ctrl control parent switch scale share".split()
)
_LAYERS = ("def", "org")
_WORDS = sorted(
    {*_FINGERS, *_PARTS, *_HANDS, *(word for word in _SIDES if len(word) > 1), "finger", "toe", "twist", "phalanx"},
    key=len,
    reverse=True,
)
_GLUED = re.compile(f"(?:{'|'.join(_WORDS)})+")
_WORD = re.compile("|".join(_WORDS))
_TOKEN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_COPY = re.compile(r"\.\d{3}$")


@dataclass(frozen=True)
class BoneWords:
    """A name taken apart.

    Attributes:
        side: of the body; None where the name has none.
        finger: MANO's name of the finger; None: of none, or only numbered.
        number: of the finger where fingers are numbered (`finger2-1`); None otherwise.
        place: along the finger: 1, 2, 3 from the knuckle, `METACARPAL` before, `TIP` behind; None: not told. Numbers
            in names are given as they are, 0 and 4 among them.
        is_hand: the hand or the wrist itself.
        layer: "def" and "org" bones of Rigify repeat their controls; "" for all others.
        is_copy: Blender has numbered the name (`.001`).
    """

    side: Side | None
    finger: str | None
    number: int | None
    place: float | None
    is_hand: bool
    layer: str
    is_copy: bool


def read_words(name: str) -> BoneWords | None:
    """What a bone's name says, None for a bone that carries no joint of a hand: a twist, a control, a toe."""
    tokens = _tokens(_COPY.sub("", name.rpartition(":")[2]))
    if _OTHERS & set(tokens):
        return None
    side: Side | None = next((_SIDES[token] for token in tokens if token in _SIDES), None)
    finger, at = _finger(tokens)
    number, place = None, None
    if finger:
        place = _place(tokens[:at] + tokens[at + 1 :], tokens[at + 1 :])
    elif "finger" in tokens:
        number, place = _numbered(tokens[tokens.index("finger") + 1 :])
    is_hand = bool(_HANDS & set(tokens)) and not finger and "finger" not in tokens and _extra(tokens) == 0
    layer = tokens[0] if tokens and tokens[0] in _LAYERS else ""
    return BoneWords(side, finger, number, place, is_hand, layer, bool(_COPY.search(name)))


def _tokens(name: str) -> list[str]:
    """Lower-case words and numbers; words that are written together are told apart where all of them are known."""
    tokens = []
    for token in _TOKEN.findall(name):
        low = token.lower()
        tokens += _WORD.findall(low) if _GLUED.fullmatch(low) else [low]
    return tokens


def _finger(tokens: list[str]) -> tuple[str | None, int]:
    """The finger, and where it is told; of `ring` and `middle` in one name the second is a part of the first."""
    found = [(token, at) for at, token in enumerate(tokens) if token in _FINGERS]
    if not found:
        return None, -1
    token, at = next((pair for pair in found if pair[0] not in ("middle", "mid")), found[0])
    return _FINGERS[token], at


def _place(others: list[str], behind: list[str]) -> float | None:
    """From a part's name, or else from the first number or letter behind the finger's."""
    parts = [_PARTS[token] for token in others if token in _PARTS]
    if "in" in others and "hand" in others:  # RightInHandIndex
        return METACARPAL
    if parts:
        return max(parts) if TIP in parts else parts[0]
    numbers = [float(token) for token in behind if token.isdigit()]
    letters = [_LETTERS[token] for token in behind if token in _LETTERS]
    return (numbers or letters or [None])[0]


def _numbered(behind: list[str]) -> tuple[int | None, float | None]:
    """`finger2-1` is the second finger's first bone; `finger21` finger 2's second, for `finger2` is its first."""
    numbers = [token for token in behind if token.isdigit()]
    parts = [_PARTS[token] for token in behind if token in _PARTS]
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
    """Words that make of a hand's name another bone's."""
    return sum(token in _PARTS or token in ("in", "base") for token in tokens)
