"""Where the digits of a hand come near each other and the palm.

The surface near a point is taken for a plane at the nearest point of the other digit: exact enough where they touch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from .contact_hand import PALM, ContactHand

_FOLD_M = 0.012  # points nearer to a digit at rest belong to the fold between the two
_NEAR_M = 0.008
_WEB_SHARE = 0.6  # of a proximal phalanx: from there on neighbours can pass through each other


class OwnContacts(NamedTuple):
    """K points near another digit.

    Attributes:
        points: [K] which.
        others: [K] the nearest point of the other digit.
        outward: [K, 3] unit normals there.
        gap_m: [K] height over it, negative inside.
    """

    points: np.ndarray
    others: np.ndarray
    outward: np.ndarray
    gap_m: np.ndarray


class OwnContactSearch:
    """Finds contacts of a hand with itself in many poses."""

    def __init__(self, hand: ContactHand):
        """Tell which points can meet which digits."""
        self._hand = hand
        self._digits = [_neighbours_together(hand, np.flatnonzero(hand.digit == digit)) for digit in range(6)]
        can = np.stack([_can_meet(hand, digit) for digit in range(6)], 1)
        self._meets = [np.flatnonzero(can[:, digit]) for digit in range(6)]

    def contacts(
        self,
        vertices: np.ndarray,
        margin_m: float,
        movers: np.ndarray | None = None,
        obstacles: np.ndarray | None = None,
    ) -> OwnContacts:
        """Find the points that are lower over another digit than a margin.

        Args:
            vertices: [N, 3] m, posed.
            margin_m: negative: only what is deeper than this.
            movers: [5] digits of which each contact has one; None: all.
            obstacles: [5] digits of which its other side is one.
        """
        points, normals = self._hand.points(vertices), self._hand.normals(vertices)
        found = []
        for digit in range(6):
            meets = self._meets[digit]
            if movers is not None and obstacles is not None:
                meets = meets[self._pairs(digit, movers, obstacles)[self._hand.digit[meets]]]
            found.append(self._with(digit, meets, points, normals, margin_m))
        return OwnContacts(*(np.concatenate(rows) for rows in zip(*found, strict=True)))

    @staticmethod
    def _pairs(digit: int, movers: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
        """Return [6] which digits make a pair of a mover and an obstacle with one; the palm is an obstacle."""
        moves, stands = np.append(movers, False), np.append(obstacles, True)
        return (moves & stands[digit]) | (stands & moves[digit])

    def _with(
        self, digit: int, meets: np.ndarray, points: np.ndarray, normals: np.ndarray, margin_m: float
    ) -> OwnContacts:
        from ..compute.kernels.near_points import find_near_points

        other = np.empty(len(meets), np.int64)
        find_near_points(points, meets, self._digits[digit], margin_m, _NEAR_M, other)
        near, other = meets[other >= 0], other[other >= 0]
        gap = np.einsum("kc,kc->k", points[near] - points[other], normals[other])
        # What lies before the other's surface while it looks the same way is on its far side, not in it.
        meets_face = np.einsum("kc,kc->k", normals[near], normals[other]) < 0.5
        low = meets_face & (gap < margin_m)
        return OwnContacts(near[low], other[low], normals[other[low]], gap[low])


def _neighbours_together(hand: ContactHand, points: np.ndarray) -> np.ndarray:
    """Sort some points so that neighbours follow each other."""
    from ..compute.kernels.nearest import along_curve

    return points[np.argsort(along_curve(hand.rest[points]), kind="stable")]


def _can_meet(hand: ContactHand, digit: int) -> np.ndarray:
    """Return [P] which points can meet a digit: none of its own, nor of the folds between the two.

    The palm is met by what lies beyond a digit's first phalanx, whose flesh folds with its own.
    """
    is_beyond = (hand.digit != PALM) & ((hand.joint - 1) % 3 > 0)
    rest = torch.as_tensor(hand.rest)
    distance = torch.cdist(rest, rest[torch.as_tensor(hand.digit == digit)]).amin(1).numpy()
    if digit == PALM:
        return is_beyond & (distance >= _FOLD_M)
    is_other = (hand.digit != digit) & (hand.digit != PALM)
    return is_other & ((distance >= _FOLD_M) | is_beyond | _is_beyond_web(hand))


def _is_beyond_web(hand: ContactHand) -> np.ndarray:
    """Return [P] which points of first phalanges lie beyond the webs between the digits."""
    is_beyond = np.zeros(len(hand.rest), bool)
    for first in range(1, 16, 3):
        start, end = hand.rest_joints[first], hand.rest_joints[first + 1]
        along = (hand.rest - start) @ (end - start) / ((end - start) @ (end - start))
        is_beyond |= (hand.joint == first) & (along > _WEB_SHARE)
    return is_beyond
