"""Which of a finger's bones are its three joints and its tip, where there may be a metacarpal and more behind."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# A chain that begins within this share of its first bone's length from the wrist begins with a metacarpal: a knuckle
# lies two such lengths away.
_NEAR_WRIST = 0.7


class Joints(NamedTuple):
    """Three bones, None where there is none, and the bone at the tip."""

    bones: tuple[int | None, int | None, int | None]
    tip: int | None


def joints_of_chain(chain: list[int], heads: np.ndarray, wrist: int | None, is_thumb: bool) -> Joints:
    """From a finger's bones, in order, of which names tell nothing.

    Args:
        chain: indices of bones, the knuckle's side first.
        heads: [B, 3] m.
        wrist: index of the wrist's bone, if known.
        is_thumb: whose metacarpal is its first joint.
    """
    if len(chain) > 3 and not is_thumb and wrist is not None:
        first = np.linalg.norm(heads[chain[1]] - heads[chain[0]])
        if np.linalg.norm(heads[chain[0]] - heads[wrist]) < _NEAR_WRIST * first:
            chain = chain[1:]
    if len(chain) > 4:
        chain = chain[-4:]
    padded = [*chain, None, None, None, None]
    return Joints((padded[0], padded[1], padded[2]), padded[3])
