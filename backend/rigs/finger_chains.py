"""Finds the three joints and the tip in a finger's chain of bones, which may begin with a metacarpal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Millimetres from the wrist to a finger's first joint, and from joint to joint, of the built-in hand: only their ratios
# count. A metacarpal begins at the wrist and is as long as the palm, a bone at the tip begins two lengths too far.
_FINGER_MM, _THUMB_MM = (91.0, 40.0, 23.0), (32.0, 46.0, 32.0)
_WITH_METACARPAL = 4  # bones of a finger
_TOGETHER, _BEHIND = 0.35, 1.2  # of the palm's length: how far metacarpals begin from each other, and from a forearm
_SHORTEST = 1e-6  # of the longest length: bones in one place are no joints


class FingerBones(NamedTuple):
    """The bones of a finger's three joints and the bone that begins at its tip; None where there is none."""

    joints: tuple[int | None, int | None, int | None]
    tip: int | None


def finger_of_chain(chain: list[int], heads: np.ndarray, wrist: int | None, is_thumb: bool) -> FingerBones:
    """Find the finger of a chain of bones, from geometry alone: the three that lie where the joints of a finger do.

    Args:
        chain: indices of bones, from the palm outwards.
        heads: [B, 3] m.
        wrist: index of the wrist's bone; None if unknown.
        is_thumb: the thumb's first joint is at its metacarpal.
    """
    starts, first = range(max(1, len(chain) - 2)), 0
    if wrist is None:
        first = starts[-2:][0]  # a tip, no metacarpal
    elif len(starts) > 1:
        first = min(starts, key=lambda start: _unlikeness([wrist, *chain[start : start + 3]], heads, is_thumb))
    padded = [*chain[first:], None, None, None, None]
    return FingerBones((padded[0], padded[1], padded[2]), padded[3])


def lacks_wrist(heads: np.ndarray, above: int, chains: list[list[int]]) -> bool:
    """Tell whether fingers' chains begin at a wrist that has no bone: in one place, far from the bone above them.

    Args:
        heads: [B, 3] m.
        above: index of the bone that the chains hang from, such as a forearm.
        chains: indices of each finger's bones, from the palm outwards.
    """
    if min(len(chain) for chain in chains) < _WITH_METACARPAL:
        return False
    firsts = heads[[chain[0] for chain in chains]]
    palm = np.linalg.norm(heads[[chain[1] for chain in chains]] - firsts, axis=1).max()
    apart = np.linalg.norm(firsts - firsts.mean(0), axis=1).max()
    behind = np.linalg.norm(firsts.mean(0) - heads[above])
    return bool(apart < _TOGETHER * palm and behind > _BEHIND * palm)


def _unlikeness(bones: list[int], heads: np.ndarray, is_thumb: bool) -> float:
    """Tell how much the ratios of the lengths between wrist and joints differ from a finger's."""
    lengths = np.linalg.norm(np.diff(heads[bones], axis=0), axis=1)
    usual = np.array(_THUMB_MM if is_thumb else _FINGER_MM)[: len(lengths)]
    return float(np.std(np.log(np.maximum(lengths, _SHORTEST * lengths.max(initial=1e-12)) / usual)))
