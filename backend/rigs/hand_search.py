"""Finds hands in a skeleton by its shape: a bone with five chains below; thumb and side follow from positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..records.side import Side
from .finger_chains import FingerBones, finger_of_chain, lacks_wrist
from .source_skeleton import SourceSkeleton, unit

# Fingers bent, or a thumb out of the palm's plane, by less than this do not show the palm: sine, share of the length.
_LEAST_BEND, _LEAST_OFFSET = 0.03, 0.03
_MIDDLE, _THUMB = 1, 4  # among the fingers in MANO's order
_KNUCKLES = [1, 4, 10, 7]  # from the index to the little finger


@dataclass(frozen=True)
class FoundHand:
    """A hand found by shape.

    Attributes:
        wrist: index of its bone; where a hand has none, of the middle finger's metacarpal, which begins there.
        fingers: index, middle, pinky, ring, thumb.
        side: None if the rest pose does not show the palm.
    """

    wrist: int
    fingers: tuple[FingerBones, ...]
    side: Side | None


def find_hands(skeleton: SourceSkeleton) -> list[FoundHand]:
    """Find all bones with five chains of at least three bones below them."""
    found = []
    for bone in range(len(skeleton.names)):
        below = [_chain(skeleton, child) for child in skeleton.children(bone)]
        chains = [chain for chain in below if len(chain) >= 3]
        if len(chains) == 5:
            found.append(_hand(skeleton, bone, chains))
    return found


def side_of(heads: np.ndarray) -> Side | None:
    """Tell the side of joints [16, 3] in MANO's order: from the bend of the fingers, else from the thumb's position.

    Joints that are not known are NaN; of the wrist and two knuckles all must be.
    """
    wrist, knuckles = heads[0], heads[_KNUCKLES]
    knuckles = knuckles[np.isfinite(knuckles).all(1)]
    middle = knuckles.mean(0) - wrist
    along = unit(middle)
    across = knuckles[0] - knuckles[-1]
    towards_thumb = unit(across - (across @ along) * along)
    palmar = np.cross(towards_thumb, along)  # out of the palm of a right hand
    bends = np.array([_bend(heads[first : first + 3], along) for first in _KNUCKLES])
    lean = float(np.where(np.isfinite(bends), bends, 0).mean(0) @ palmar)
    if abs(lean) < _LEAST_BEND:
        thumb = heads[13:16][np.isfinite(heads[13:16]).all(1)]
        offset = float((thumb.mean(0) - wrist) @ palmar / np.linalg.norm(middle)) if len(thumb) else 0.0
        lean = offset if abs(offset) > _LEAST_OFFSET else 0.0
    return None if lean == 0 else "right" if lean > 0 else "left"


def _hand(skeleton: SourceSkeleton, above: int, chains: list[list[int]]) -> FoundHand:
    heads = skeleton.heads
    order = _order(heads, above, chains)
    wrist, ordered = above, [chains[k] for k in order]
    if lacks_wrist(heads, above, ordered):
        wrist, ordered = ordered[_MIDDLE][0], [chain[1:] for chain in ordered]
    fingers = tuple(finger_of_chain(chain, heads, wrist, k == _THUMB) for k, chain in enumerate(ordered))
    joints = [wrist, *(bone for finger in fingers for bone in finger.joints if bone is not None)]
    return FoundHand(wrist, fingers, side_of(heads[joints]) if len(joints) == 16 else None)


def _order(heads: np.ndarray, wrist: int, chains: list[list[int]]) -> tuple[int, ...]:
    """Find which of the chains is the index, middle, pinky, ring finger and the thumb."""
    ends = np.array([heads[chain[-1]] for chain in chains]) - heads[wrist]
    along = unit(ends.mean(0))
    thumb = int(np.argmin(ends @ along))
    others = [k for k in range(5) if k != thumb]
    starts = np.array([heads[chains[k][len(chains[k]) > 3]] for k in others])
    # The order of the fingers along the line of the knuckles, from the thumb's side.
    _, _, axes = np.linalg.svd(starts - starts.mean(0))
    line = axes[0] * np.sign(axes[0] @ (heads[chains[thumb][1]] - starts.mean(0)))
    index, middle, ring, pinky = (others[k] for k in np.argsort(-(starts @ line)))
    return index, middle, pinky, ring, thumb


def _chain(skeleton: SourceSkeleton, bone: int) -> list[int]:
    """Follow a bone's descendants along the longest branch; empty if more than one branch is longer than a bone."""
    chain = [bone]
    while children := skeleton.children(chain[-1]):
        depths = [_depth(skeleton, child) for child in children]
        longest = int(np.argmax(depths))
        if sum(depth > 1 for depth in depths) > 1:  # not a finger
            return []
        chain.append(children[longest])
    return chain


def _depth(skeleton: SourceSkeleton, bone: int) -> int:
    return 1 + max((_depth(skeleton, child) for child in skeleton.children(bone)), default=0)


def _bend(joints: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the difference [3] of directions of a finger's second and first bone, across the hand's length."""
    first, second = unit(joints[1] - joints[0]), unit(joints[2] - joints[1])
    return second - first - ((second - first) @ along) * along
