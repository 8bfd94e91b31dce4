"""Finds the three joints and the tip in a finger's chain of bones, which may begin with a metacarpal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# A chain whose first bone begins nearer to the wrist than this share of its own length begins with a metacarpal: a
# knuckle lies about two bone lengths away.
_METACARPAL_DISTANCE = 0.7


class FingerBones(NamedTuple):
    """The bones of a finger's three joints and the bone that begins at its tip; None where there is none."""

    joints: tuple[int | None, int | None, int | None]
    tip: int | None


def finger_of_chain(chain: list[int], heads: np.ndarray, wrist: int | None, is_thumb: bool) -> FingerBones:
    """The finger of a chain of bones, from geometry alone.

    Args:
        chain: indices of bones, from the palm outwards.
        heads: [B, 3] m.
        wrist: index of the wrist's bone; None if unknown.
        is_thumb: the thumb's first joint is at its metacarpal.
    """
    if len(chain) > 3 and not is_thumb and wrist is not None:
        first = np.linalg.norm(heads[chain[1]] - heads[chain[0]])
        if np.linalg.norm(heads[chain[0]] - heads[wrist]) < _METACARPAL_DISTANCE * first:
            chain = chain[1:]
    if len(chain) > 4:
        chain = chain[-4:]
    padded = [*chain, None, None, None, None]
    return FingerBones((padded[0], padded[1], padded[2]), padded[3])
