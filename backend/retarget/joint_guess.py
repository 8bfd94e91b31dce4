"""A skeleton -> which of its bones are a hand's joints: by their names, and where those tell nothing by shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..hand.gestures import FINGERS
from ..hand.model import JOINT_NAMES
from ..records.errors import LiveHandError
from ..records.shot import SIDES, Side
from .bone_names import METACARPAL, TIP, BoneWords, read_words
from .finger_chains import Joints, joints_of_chain
from .hand_search import FoundHand, find_hands, side_of
from .source_skeleton import JointMap, RestSkeleton

_LAYERS = ("def", "", "org")  # Rigify's deform bones do what controls and constraints together say


@dataclass(frozen=True)
class Guess:
    """A joint map that may have gaps.

    Attributes:
        side: of the hand.
        bones: 16 names in MANO's order, None where no bone was found.
        tips: five names or None, in MANO's order of fingers.
    """

    side: Side
    bones: tuple[str | None, ...]
    tips: tuple[str | None, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the joints without a bone."""
        return tuple(joint for joint, bone in zip(JOINT_NAMES, self.bones, strict=True) if bone is None)

    def joint_map(self) -> JointMap:
        """The map, if it is whole.

        Raises:
            LiveHandError: a joint has no bone.
        """
        if self.missing:
            raise LiveHandError(
                f"every joint of the {self.side} hand must have a bone, none was found for {', '.join(self.missing)}; "
                "choose them by hand"
            )
        return JointMap(self.side, tuple(bone or "" for bone in self.bones), self.tips)


def guess_joints(skeleton: RestSkeleton, side: Side | None = None) -> Guess:
    """The best guess for one hand of a skeleton.

    Args:
        skeleton: of a hand, or of a whole body.
        side: which hand; None: the one that more is found of, the right one of two.
    """
    guesses = [guess for wanted in SIDES if (guess := _guess(skeleton, wanted)) and side in (None, wanted)]
    nothing = Guess(side or "right", (None,) * 16, (None,) * 5)
    return min(guesses, key=lambda guess: len(guess.missing), default=nothing)


def _guess(skeleton: RestSkeleton, side: Side) -> Guess | None:
    """None where the skeleton shows no such hand."""
    by_names = _by_names(skeleton, side)
    if by_names and not by_names.missing:
        return by_names
    shapes = [hand for hand in find_hands(skeleton) if _side_at(skeleton, hand) in (side, None)]
    by_shape = [_of_shape(skeleton, hand, side) for hand in shapes]
    found = [guess for guess in (by_names, *by_shape) if guess and len(guess.missing) < 15]
    return min(found, key=lambda guess: len(guess.missing), default=by_names)


def _by_names(skeleton: RestSkeleton, side: Side) -> Guess | None:
    words = [read_words(name) for name in skeleton.names]
    sides = _sides(skeleton, words)
    guesses = []
    for own in (side, None):
        for layer in _LAYERS:
            bones = [k for k, said in enumerate(words) if said and said.layer == layer and sides[k] == own]
            guess = _named_hand(skeleton, {k: said for k in bones if (said := words[k])}, side)
            if own is None and not _may_be(skeleton, guess, side):
                continue
            guesses.append(guess)
    best = min(guesses, key=lambda guess: len(guess.missing))
    return best if len(best.missing) < 15 else None


def _sides(skeleton: RestSkeleton, words: list[BoneWords | None]) -> list[Side | None]:
    """A bone without a side has that of the next above that has one."""
    sides: list[Side | None] = []
    for said, parent in zip(words, skeleton.parents, strict=True):
        above = sides[parent] if parent >= 0 else None
        sides.append(said.side if said and said.side else above)
    return sides


def _may_be(skeleton: RestSkeleton, guess: Guess, side: Side) -> bool:
    """Whether a hand whose names have no side may be this one."""
    if guess.missing:
        return len(guess.missing) < 15 and side == "right"
    bones = [skeleton.index(bone) for bone in guess.bones if bone]
    return side_of(skeleton.heads[bones]) in (side, None)


def _named_hand(skeleton: RestSkeleton, words: dict[int, BoneWords], side: Side) -> Guess:
    fingers = _bones_of_fingers(words)
    wrist = _wrist(skeleton, words, [bones for bones in fingers.values() if bones])
    joints = [
        _joints(skeleton, {bone: words[bone] for bone in fingers[finger]}, wrist, finger == "thumb")
        for finger in FINGERS
    ]
    return _named(skeleton, wrist, joints, side)


def _bones_of_fingers(words: dict[int, BoneWords]) -> dict[str, list[int]]:
    """Each finger's bones, whether named or numbered; numbers begin at the thumb where no bone is named after that."""
    fingers = {finger: [k for k, said in words.items() if said.finger == finger] for finger in FINGERS}
    numbers = sorted({said.number for said in words.values() if said.number is not None})
    order = ("thumb", "index", "middle", "ring", "pinky")[bool(fingers["thumb"]) :]
    if len(numbers) == len(order):
        for finger, number in zip(order, numbers, strict=True):
            fingers[finger] += [k for k, said in words.items() if said.number == number]
    return fingers


def _joints(skeleton: RestSkeleton, words: dict[int, BoneWords], wrist: int | None, is_thumb: bool) -> Joints:
    placed = {bone: said.place for bone, said in words.items() if said.place is not None}
    best: dict[float, int] = {}
    for bone, place in placed.items():
        rank = (words[bone].is_copy, len(skeleton.names[bone]))
        if place not in best or rank < (words[best[place]].is_copy, len(skeleton.names[best[place]])):
            best[place] = bone
    tip = best.pop(TIP, None)
    if not is_thumb:
        best.pop(METACARPAL, None)
    if 0.0 in best and len(best) > 3:  # counted from 0, which lies in the palm
        best.pop(0.0)
    chain = [best[place] for place in sorted(best)]
    if len(chain) > 3 or (is_thumb and METACARPAL in best):
        found = joints_of_chain(chain, skeleton.heads, wrist, is_thumb)
        return found if tip is None else found._replace(tip=tip)
    return Joints(_at_places(best), tip)


def _at_places(best: dict[float, int]) -> tuple[int | None, int | None, int | None]:
    """Three bones or fewer: by their own numbers, so that a gap is where it is."""
    first = 0.0 if 0.0 in best else 1.0
    bones = [best.get(first + k) for k in range(3)]
    return bones[0], bones[1], bones[2]


def _wrist(skeleton: RestSkeleton, words: dict[int, BoneWords], fingers: list[list[int]]) -> int | None:
    """The lowest bone above all fingers that is named after the hand, or else the lowest of all above them."""
    hands = [bone for bone, said in words.items() if said.is_hand]
    if not fingers:
        return min(hands, key=lambda bone: len(skeleton.names[bone]), default=None)
    firsts = [bones[0] for bones in fingers]
    above = [skeleton.ancestors(bone) for bone in firsts]
    shared = [bone for bone in above[0] if all(bone in others for others in above)]
    named = [bone for bone in shared if bone in hands]
    if named:
        return named[0]
    if hands:  # Rigify's deform bones do not hang together
        middle = skeleton.heads[firsts].mean(0)
        return min(hands, key=lambda bone: float(np.linalg.norm(skeleton.heads[bone] - middle)))
    own = {bone for bones in fingers for bone in bones}
    return next((bone for bone in shared if bone not in own and len(fingers) > 2), None)


def _side_at(skeleton: RestSkeleton, hand: FoundHand) -> Side | None:
    """What the names of the bones above a hand say, or else its shape."""
    for bone in (hand.wrist, *skeleton.ancestors(hand.wrist)):
        said = read_words(skeleton.names[bone])
        if said and said.side:
            return said.side
    return hand.side


def _of_shape(skeleton: RestSkeleton, hand: FoundHand, side: Side) -> Guess:
    return _named(skeleton, hand.wrist, list(hand.fingers), side)


def _named(skeleton: RestSkeleton, wrist: int | None, fingers: list[Joints], side: Side) -> Guess:
    bones = [wrist, *(bone for finger in fingers for bone in finger.bones)]
    names = tuple(None if bone is None else skeleton.names[bone] for bone in bones)
    tips = tuple(None if finger.tip is None else skeleton.names[finger.tip] for finger in fingers)
    return Guess(side, names, tips)
