"""Whether a camera rests: what the hand does not cover is the same in all frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

MOST_CHANGE = 8.0
"""Of 255, median, between frames of a camera that rests."""


def ground_change(pictures: Sequence[np.ndarray], covered: Sequence[np.ndarray]) -> float | None:
    """Compute the largest median change, of 255, from the first picture to another; None where nothing is seen in both.

    Args:
        pictures: uint8 [H, W, 3], frames of the footage.
        covered: [H, W] bool, where the hand may be.
    """
    if not pictures:
        return None
    first, mask = pictures[0].astype(np.int16), covered[0]
    changes = []
    for picture, other in zip(pictures[1:], covered[1:], strict=True):
        seen = ~(mask | other)
        if seen.any():
            changes.append(float(np.median(np.abs(picture[seen].astype(np.int16) - first[seen]))))
    return max(changes, default=None)
