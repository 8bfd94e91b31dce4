"""Finds the three joints and the tip in a finger's chain of bones, which may begin with a metacarpal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Millimetres from the wrist to a finger's first joint, and from joint to joint, of the built-in hand: only their ratios
# count. A metacarpal begins at the wrist and is as long as the palm, a bone at the tip begins two lengths too far.
_FINGER_MM, _THUMB_MM = (91.0, 40.0, 23.0), (32.0, 46.0, 32.0)
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


def _unlikeness(bones: list[int], heads: np.ndarray, is_thumb: bool) -> float:
    """Tell how much the ratios of the lengths between wrist and joints differ from a finger's."""
    lengths = np.linalg.norm(np.diff(heads[bones], axis=0), axis=1)
    usual = np.array(_THUMB_MM if is_thumb else _FINGER_MM)[: len(lengths)]
    return float(np.std(np.log(np.maximum(lengths, _SHORTEST * lengths.max(initial=1e-12)) / usual)))
