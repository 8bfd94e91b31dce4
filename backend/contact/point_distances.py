"""Distances of a hand's points from solids while it moves: measured again only where they may count.

A point that moves by a way comes nearer to a thing by no more than it, so a bound is known without measuring.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .contact_hand import ContactHand
from .placed_solids import Solids

_LOOK_M = 0.002  # points whose bounds exceed the least by less are measured with it


class PointDistances:
    """Of all points of one hand, in its wrist's frame.

    Attributes:
        points: [P, 3] m, of the present pose.
        signed_m: [P] distances, or less where they are not measured in the present pose.
        outward: [P, 3] unit vectors, of the points that are measured.
    """

    def __init__(self, hand: ContactHand, solids: Solids):
        """Know nothing yet; `move` the hand first."""
        self._hand, self._solids = hand, solids
        count = len(hand.digit)
        self.points = np.zeros((0, 3))
        self.signed_m, self.outward = np.full(count, -np.inf), np.zeros((count, 3))
        self._is_measured = np.zeros(count, bool)

    def move(self, vertices: np.ndarray) -> None:
        """Give the hand's vertices [N, 3] m another pose."""
        before, self.points = self.points, self._hand.points(vertices)
        self._is_measured[:] = False
        if len(before):
            self.signed_m -= np.linalg.norm(self.points - before, axis=1)
            return
        self._measure(np.arange(len(vertices)))
        corner = self._hand.corners[:, 0]
        off_m = np.linalg.norm(self.points - self.points[corner], axis=1)
        self.signed_m = self.signed_m[corner] - off_m

    def below(self, limit_m: float, among: np.ndarray) -> np.ndarray:
        """Find which of some points [K] are nearer than a limit, exactly."""
        near = among[self.signed_m[among] < limit_m]
        self._measure(near[~self._is_measured[near]])
        return near[self.signed_m[near] < limit_m]

    def nearest(self, groups: Sequence[np.ndarray]) -> np.ndarray:
        """Find the nearest point of each of some groups of points."""
        look_m = _LOOK_M
        while True:
            least = np.array([group[self.signed_m[group].argmin()] for group in groups], np.int64)
            unsure = [group for group, point in zip(groups, least, strict=True) if not self._is_measured[point]]
            if not unsure:
                return least
            near = [group[self.signed_m[group] <= self.signed_m[group].min() + look_m] for group in unsure]
            look_m *= 2
            which = np.concatenate(near)
            self._measure(which[~self._is_measured[which]])

    def _measure(self, which: np.ndarray) -> None:
        if len(which):
            found = self._solids.distances(self.points[which])
            self.signed_m[which], self.outward[which] = found
            self._is_measured[which] = True
