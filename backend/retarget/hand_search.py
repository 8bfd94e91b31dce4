"""Hands found by shape alone: a bone with five chains below it; the thumb by its place, the side by thumb and palm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..records.shot import Side
from .finger_chains import Joints, joints_of_chain
from .source_skeleton import RestSkeleton

# A finger bent, or a thumb off the palm's plane, by less than this tells nothing about the palm: sine, share of length.
_LEAST_BEND, _LEAST_OFFSET = 0.03, 0.03


@dataclass(frozen=True)
class FoundHand:
    """A hand without names.

    Attributes:
        wrist: index of its bone.
        fingers: index, middle, pinky, ring, thumb.
        side: None where the rest pose does not show the palm.
    """

    wrist: int
    fingers: tuple[Joints, ...]
    side: Side | None


def find_hands(skeleton: RestSkeleton) -> list[FoundHand]:
    """All bones with five chains of three bones or more below them."""
    found = []
    for bone in range(len(skeleton.names)):
        below = [_chain(skeleton, child) for child in skeleton.children(bone)]
        chains = [chain for chain in below if len(chain) >= 3]
        if len(chains) == 5:
            found.append(_hand(skeleton, bone, chains))
    return found


def side_of(heads: np.ndarray) -> Side | None:
    """Whose joints [16, 3] these are, in MANO's order, from how the fingers bend or else where the thumb lies."""
    wrist, knuckles = heads[0], heads[[1, 4, 7, 10]]
    along = _unit(knuckles.mean(0) - wrist)
    across = heads[1] - heads[7]
    thumbward = _unit(across - (across @ along) * along)
    # Out of the palm of a right hand.
    palmar = np.cross(thumbward, along)
    bend = sum(_bend(heads[first : first + 3], along) for first in (1, 4, 7, 10)) / 4
    lean = bend @ palmar
    if abs(lean) < _LEAST_BEND:
        reach = np.linalg.norm(knuckles.mean(0) - wrist)
        offset = (heads[13:16].mean(0) - wrist) @ palmar / reach
        lean = offset if abs(offset) > _LEAST_OFFSET else 0.0
    return None if lean == 0 else "right" if lean > 0 else "left"


def _hand(skeleton: RestSkeleton, wrist: int, chains: list[list[int]]) -> FoundHand:
    heads = skeleton.heads
    ends = np.array([heads[chain[-1]] for chain in chains]) - heads[wrist]
    along = _unit(ends.mean(0))
    thumb = int(np.argmin(ends @ along))
    others = [k for k in range(5) if k != thumb]
    starts = np.array([heads[chains[k][len(chains[k]) > 3]] for k in others])
    # Along the line of the knuckles, beginning at the thumb's side.
    _, _, axes = np.linalg.svd(starts - starts.mean(0))
    line = axes[0] * np.sign(axes[0] @ (heads[chains[thumb][1]] - starts.mean(0)))
    index, middle, ring, pinky = (others[k] for k in np.argsort(-(starts @ line)))
    order = (index, middle, pinky, ring, thumb)
    fingers = tuple(joints_of_chain(chains[k], heads, wrist, k == thumb) for k in order)
    joints = [wrist, *(bone for finger in fingers for bone in finger.bones if bone is not None)]
    return FoundHand(wrist, fingers, side_of(heads[joints]) if len(joints) == 16 else None)


def _chain(skeleton: RestSkeleton, bone: int) -> list[int]:
    """A bone and its descendants while there is only one that goes on; shorter side branches are helpers."""
    chain = [bone]
    while children := skeleton.children(chain[-1]):
        depths = [_depth(skeleton, child) for child in children]
        longest = int(np.argmax(depths))
        if sum(depth > 1 for depth in depths) > 1:  # it branches: no finger
            return []
        chain.append(children[longest])
    return chain


def _depth(skeleton: RestSkeleton, bone: int) -> int:
    return 1 + max((_depth(skeleton, child) for child in skeleton.children(bone)), default=0)


def _bend(joints: np.ndarray, along: np.ndarray) -> np.ndarray:
    """[3] how far and whither a finger's second bone departs from its first, across the hand's length."""
    first, second = _unit(joints[1] - joints[0]), _unit(joints[2] - joints[1])
    return second - first - ((second - first) @ along) * along


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
