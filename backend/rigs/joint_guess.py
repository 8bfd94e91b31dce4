"""Guesses which bones of a skeleton are a hand's joints: by their names, or else by the shape of the skeleton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..hand.model import MANO_FINGERS
from ..records.errors import LiveHandError
from ..records.side import SIDES, Side
from .bone_names import INTERPHALANGEAL, METACARPAL, TIP, BoneName, parse_bone_name
from .finger_chains import FingerBones, finger_of_chain, lacks_wrist
from .hand_search import FoundHand, find_hands, side_of
from .source_skeleton import JointMap, SourceSkeleton, joints_without_bones, shows_palm

_MIDDLE = MANO_FINGERS.index("middle")
_LAYERS = ("def", "", "org")  # Rigify's deform bones first: they follow all controls and constraints

# From the wrist to where a forearm's bone begins, relative to the distance to the middle of all finger joints.
_SHORTEST_FOREARM, _LONGEST_FOREARM = 0.3, 4.0
_SHORTER = 0.95  # of a finger's second bone against its first
_SHORTEST_TIP, _LONGEST_TIP = 0.1, 2.5  # of a finger's last bone, relative to the one before


@dataclass(frozen=True)
class JointGuess:
    """A joint map that may have gaps.

    Attributes:
        side: of the hand.
        bones: 16 names in MANO's order, None if no bone was found.
        tips: five names or None, in MANO's order of fingers.
        forearm: the forearm's name, or None.
    """

    side: Side
    bones: tuple[str | None, ...]
    tips: tuple[str | None, ...]
    forearm: str | None = None

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the joints for which no bone was found."""
        return joints_without_bones(self.bones)

    @property
    def is_hand(self) -> bool:
        """Whether enough was found for a joint map."""
        return shows_palm(self.bones)

    def joint_map(self) -> JointMap:
        """Build the joint map; joints that were not found have no bone.

        Raises:
            LiveHandError: no hand was found, or not enough of it.
        """
        if len(self.missing) >= 15:
            raise LiveHandError(
                f"the armature must have a bone for the {self.side} hand's joints, there is no such hand: no bones are "
                "named like fingers, and none has five chains of bones below it; choose another armature or file, or "
                "name the bones yourself"
            )
        return JointMap(self.side, self.bones, self.tips, self.forearm)


def guess_joints(skeleton: SourceSkeleton, side: Side | None = None, is_determined: bool = False) -> JointGuess:
    """Guess the bones of one hand.

    Args:
        skeleton: of a hand or of a whole body.
        side: of the hand; None takes the hand with more bones found, of equals the right one.
        is_determined: the user has chosen the side: bones whose names tell none are of it, if no others are, even if
            the rest pose seems to be the other's.
    """
    wanted_sides = SIDES if side is None else (side,)
    guesses = [
        guess for wanted in wanted_sides if (guess := _guess(skeleton, wanted, is_determined and side is not None))
    ]
    if side and is_determined and not guesses and (reported := _by_names(skeleton, side, is_determined=True)):
        guesses = [reported]
    empty = JointGuess(side or "right", (None,) * 16, (None,) * 5)
    return min(guesses, key=lambda guess: len(guess.missing), default=empty)


def _guess(skeleton: SourceSkeleton, side: Side, is_determined: bool) -> JointGuess | None:
    """Guess the joints; None if the skeleton has no such hand."""
    by_names = _by_names(skeleton, side)
    if by_names and not by_names.missing:
        return by_names
    hands = find_hands(skeleton)
    shapes = [hand for hand in hands if _side_at(skeleton, hand) in (side, None)]
    if is_determined and not shapes:  # the rest pose seems to be the other side's
        shapes = [hand for hand in hands if _named_side_at(skeleton, hand) is None]
    by_shape = [_guess_of(skeleton, hand.wrist, hand.fingers, side) for hand in shapes]
    found = [guess for guess in (by_names, *by_shape) if guess and len(guess.missing) < 15 and _agrees(guess)]
    return min(found, key=lambda guess: len(guess.missing), default=by_names)


def _agrees(guess: JointGuess) -> bool:
    """Tell whether no bone's name says that it is of another finger, or no joint."""
    for joint, bone in enumerate(guess.bones[1:]):
        name = parse_bone_name(bone) if bone else None
        if name and name.finger and (name.finger != MANO_FINGERS[joint // 3] or name.position == TIP):
            return False
    return True


def _by_names(skeleton: SourceSkeleton, side: Side, is_determined: bool = False) -> JointGuess | None:
    names = [parse_bone_name(name) for name in skeleton.names]
    sides = _sides(skeleton, names)
    guesses = []
    for own in (side, None):
        for layer in _LAYERS:
            of_hand = {k: name for k, name in enumerate(names) if name and name.layer == layer and sides[k] == own}
            guess = _named_hand(skeleton, of_hand, side)
            if own is not None or is_determined or _may_be(skeleton, guess, side):
                guesses.append(guess)
    best = min(guesses, key=lambda guess: len(guess.missing))
    return best if len(best.missing) < 15 else None


def _sides(skeleton: SourceSkeleton, names: list[BoneName | None]) -> list[Side | None]:
    """Read the side per bone; a name without a side takes that of its parent."""
    sides: list[Side | None] = []
    for name, parent in zip(names, skeleton.parents, strict=True):
        above = sides[parent] if parent >= 0 else None
        sides.append(name.side if name and name.side else above)
    return sides


def _may_be(skeleton: SourceSkeleton, guess: JointGuess, side: Side) -> bool:
    """Tell whether a hand whose names have no side may be of this side."""
    if not guess.is_hand:
        return len(guess.missing) < 15 and side == "right"
    heads = np.array([skeleton.heads[skeleton.index(bone)] if bone else np.full(3, np.nan) for bone in guess.bones])
    return side_of(heads) in (side, None)


def _named_hand(skeleton: SourceSkeleton, names: dict[int, BoneName], side: Side) -> JointGuess:
    fingers = _bones_of_fingers(names)
    wrist = _wrist(skeleton, names, [bones for bones in fingers.values() if bones])
    if wrist is not None and not (wrist in names and names[wrist].is_hand):
        chains = [_one_chain(skeleton, fingers[finger]) for finger in MANO_FINGERS]
        wrist = chains[_MIDDLE][0] if lacks_wrist(skeleton.heads, wrist, chains) else wrist
    joints = [
        _finger(skeleton, {bone: names[bone] for bone in fingers[finger] if bone != wrist}, wrist, finger == "thumb")
        for finger in MANO_FINGERS
    ]
    return _guess_of(skeleton, wrist, joints, side)


def _bones_of_fingers(names: dict[int, BoneName]) -> dict[str, list[int]]:
    """Find the bones of each finger, named or numbered. Numbers begin at the thumb unless bones are named after it."""
    fingers = {finger: [k for k, name in names.items() if name.finger == finger] for finger in MANO_FINGERS}
    numbers = sorted({name.finger_number for name in names.values() if name.finger_number is not None})
    order = ("thumb", "index", "middle", "ring", "pinky")[bool(fingers["thumb"]) :]
    if len(numbers) == len(order):
        for finger, number in zip(order, numbers, strict=True):
            fingers[finger] += [k for k, name in names.items() if name.finger_number == number]
    return fingers


def _finger(skeleton: SourceSkeleton, names: dict[int, BoneName], wrist: int | None, is_thumb: bool) -> FingerBones:
    best: dict[float, int] = {}  # by position: originals before copies, links of the chain, shorter names
    links = {bone: _links(skeleton, bone, names) for bone in names}
    for bone in sorted(names, key=lambda bone: (names[bone].is_copy, -links[bone], len(skeleton.names[bone]))):
        position = names[bone].position
        if position is not None:
            best.setdefault(position, bone)
    tip = best.pop(TIP, None)
    if tip is not None and _is_last_joint(skeleton, best, tip):
        best[3.0], tip = tip, None
    if not is_thumb:
        best.pop(METACARPAL, None)
    chain = [best[position] for position in sorted(best)]
    if len(chain) < 2:  # names that tell the finger only
        chain = _one_chain(skeleton, [*chain, *(bone for bone in names if names[bone].position is None)])
    elif any(bone in skeleton.ancestors(above) for above, bone in pairwise(chain)):
        chain = _one_chain(skeleton, chain)
    elif len(chain) <= 3 and not (is_thumb and METACARPAL in best):
        return FingerBones(_at_positions(best), tip)
    found = finger_of_chain(chain, skeleton.heads, wrist, is_thumb)
    return found if tip is None else found._replace(tip=tip)


def _links(skeleton: SourceSkeleton, bone: int, names: dict[int, BoneName]) -> int:
    """Count the finger's positions in whose bones a bone is linked as ancestor or descendant: controls have none."""
    above = set(skeleton.ancestors(bone))
    linked = [other for other in names if other in above or bone in skeleton.ancestors(other)]
    return len({names[other].position for other in linked})


def _is_last_joint(skeleton: SourceSkeleton, best: dict[float, int], tip: int) -> bool:
    """Tell whether the bone named a tip is the finger's third, as in Root, Middle, Tip: it begins at the last joint."""
    if set(best) != {1.0, 2.0}:
        return False
    first, second, last = (skeleton.heads[bone] for bone in (best[1.0], best[2.0], tip))
    return bool(np.linalg.norm(last - second) < _SHORTER * np.linalg.norm(second - first))


def _one_chain(skeleton: SourceSkeleton, bones: list[int]) -> list[int]:
    """Order bones as the hierarchy does, as far as each is above the next."""
    chain: list[int] = []
    for bone in sorted(bones, key=lambda bone: len(skeleton.ancestors(bone))):
        if not chain or chain[-1] in skeleton.ancestors(bone):
            chain.append(bone)
    return chain


def _at_positions(best: dict[float, int]) -> tuple[int | None, int | None, int | None]:
    """Put at most three bones at their own positions, so that gaps are kept."""
    if INTERPHALANGEAL in best:  # the thumb's last joint, after MCP
        return best.get(METACARPAL), best.get(1.0), best[INTERPHALANGEAL]
    first = 0.0 if 0.0 in best else 1.0
    bones = [best.get(first + k) for k in range(3)]
    return bones[0], bones[1], bones[2]


def _wrist(skeleton: SourceSkeleton, names: dict[int, BoneName], fingers: list[list[int]]) -> int | None:
    """Find the lowest common ancestor of the fingers that is named after the hand, else the lowest of all."""
    hands = [bone for bone, name in names.items() if name.is_hand]
    if not fingers:
        return min(hands, key=lambda bone: len(skeleton.names[bone]), default=None)
    firsts = [bones[0] for bones in fingers]
    above = [skeleton.ancestors(bone) for bone in firsts]
    shared = [bone for bone in above[0] if all(bone in others for others in above)]
    named = [bone for bone in shared if bone in hands]
    if named:
        return named[0]
    if hands:  # Rigify's deform bones are not connected
        middle = skeleton.heads[firsts].mean(0)
        return min(hands, key=lambda bone: float(np.linalg.norm(skeleton.heads[bone] - middle)))
    own = {bone for bones in fingers for bone in bones}
    return next((bone for bone in shared if bone not in own and len(fingers) > 2), None)


def _side_at(skeleton: SourceSkeleton, hand: FoundHand) -> Side | None:
    """Read the side in the names of the hand's bone and those above, else in its shape."""
    return _named_side_at(skeleton, hand) or hand.side


def _named_side_at(skeleton: SourceSkeleton, hand: FoundHand) -> Side | None:
    for bone in (hand.wrist, *skeleton.ancestors(hand.wrist)):
        name = parse_bone_name(skeleton.names[bone])
        if name and name.side:
            return name.side
    return None


def _guess_of(skeleton: SourceSkeleton, wrist: int | None, fingers: Sequence[FingerBones], side: Side) -> JointGuess:
    bones = [wrist, *(bone for finger in fingers for bone in finger.joints)]
    names = tuple(None if bone is None else skeleton.names[bone] for bone in bones)
    ends = [finger.tip if _ends_finger(skeleton, finger) else None for finger in fingers]
    tips = tuple(None if tip is None else skeleton.names[tip] for tip in ends)
    return JointGuess(side, names, tips, _forearm(skeleton, wrist, [bone for bone in bones[1:] if bone is not None]))


def _forearm(skeleton: SourceSkeleton, wrist: int | None, fingers: list[int]) -> str | None:
    """Find the nearest bone above the wrist that begins as far behind it as a forearm's or its twisting part's."""
    if wrist is None or not fingers:
        return None
    hand = skeleton.heads[fingers].mean(0) - skeleton.heads[wrist]
    length = np.linalg.norm(hand)
    for bone in skeleton.ancestors(wrist):
        behind = skeleton.heads[wrist] - skeleton.heads[bone]
        distance = np.linalg.norm(behind)
        if distance > _SHORTEST_FOREARM * length:
            is_forearm = distance < _LONGEST_FOREARM * length and behind @ hand > 0
            return skeleton.names[bone] if is_forearm else None
    return None


def _ends_finger(skeleton: SourceSkeleton, finger: FingerBones) -> bool:
    """Tell whether the bone that is named a tip lies where one can: some rigs leave theirs at the palm."""
    before, last, tip = finger.joints[1], finger.joints[2], finger.tip
    if before is None or last is None or tip is None:
        return tip is not None
    length, own = (np.linalg.norm(skeleton.heads[b] - skeleton.heads[a]) for a, b in ((before, last), (last, tip)))
    return bool(_SHORTEST_TIP * length < own < _LONGEST_TIP * length)
