"""The shape of a hand from what no pose changes: the lengths of its phalanges, and the distances within its palm.

A whole take tells them, so the shape is known before any pose is; fitted in turn with the poses, it would creep.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from .skeleton import HandSkeleton

PALM_PAIRS = tuple(combinations((0, 1, 5, 9, 13, 17), 2))
"""Of the wrist and the first joints of all fingers, which move as one."""
BONES = tuple((4 * finger + k, 4 * finger + k + 1) for finger in range(5) for k in (1, 2))
"""From joint to joint."""
TIP_BONES = tuple((4 * finger + 3, 4 * finger + 4) for finger in range(5))
"""From the last joint to the tip."""
_PAIRS = np.array([*PALM_PAIRS, *BONES, *TIP_BONES])
_STEPS = 8
_SHORTEST_M = 1e-9


def shape_of_lengths(nodes: np.ndarray, skeleton: HandSkeleton, deviation_m: float) -> np.ndarray:
    """Find the beta [10] whose bones have the mean lengths of a take's.

    Args:
        nodes: [T, 21, 3] m, of one hand of the skeleton's size.
        skeleton: of the model.
        deviation_m: standard deviation of a length; the less, the less the shape is drawn to the mean one.
    """
    first, second = _PAIRS.T
    lengths_m = np.linalg.norm(nodes[:, first] - nodes[:, second], axis=-1).mean(0)
    rest, slope = (of[first] - of[second] for of in (skeleton.rest, skeleton.shape))  # [N, 3], [N, 3, 10]
    beta = np.zeros(slope.shape[-1])
    for _ in range(_STEPS):
        bones = rest + slope @ beta
        now_m = np.maximum(np.linalg.norm(bones, axis=-1), _SHORTEST_M)
        rows = np.einsum("nc,nck->nk", bones / now_m[:, None], slope) / deviation_m
        missing = (lengths_m - now_m) / deviation_m + rows @ beta
        beta = np.linalg.solve(rows.T @ rows + np.eye(len(beta)), rows.T @ missing)
    return beta
