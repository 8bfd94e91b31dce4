"""Bends the digits from a pose towards a fist until they touch: proximal joints stop first, the others go on.

Steps are hardly longer than the free way (conservative advancement), so that no digit jumps through a thin thing.
The thumb follows the fingers, and stops at them too. A finger's last joint bends with the one before it, as the tendon
that bends both has it, and hardly farther.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..hand.gestures import GESTURES
from .contact_hand import ContactHand
from .own_contacts import OwnContactSearch
from .point_distances import PointDistances

_TOUCH_M = 0.0005
_LEAST_STEP = 0.004  # of the way to the fist
_STRIDE = 1.2  # of the free way; its bound is that of the farthest point
_MOST_STEPS = 40
_OPENINGS = np.linspace(0, 1, 7)[1:]
_SIDEWAYS_RAD = np.deg2rad([0.0, 12.0, -12.0])  # of a knuckle
_SLIGHT_M = 0.0015  # depth of a digit that is pushed out rather than opened
_LAST_SHARE, _LAST_SLACK_RAD = 2 / 3, np.deg2rad(10.0)  # of a finger's last joint, of the bend of the one before
_HELD_M = 0.0005  # from the depth that is wanted: digits that are there already are not bent
_NEAR_M = 0.006  # other digits that are farther away are not looked at
_FINGERS, _THUMB = np.arange(5) < 4, np.arange(5) == 4


@dataclass(frozen=True)
class Closing:
    """Angles [15, 3] rad in which the digits touch or are closed, and [5] which digits touch a thing."""

    angles: np.ndarray
    touches: np.ndarray


class Closer:
    """Closes one hand on solids in its wrist's frame."""

    def __init__(self, hand: ContactHand, distances: PointDistances, own: OwnContactSearch):
        """Take what is asked in every step."""
        self._hand, self._distances, self._own = hand, distances, own
        self._points = [np.flatnonzero(hand.digit == digit) for digit in range(5)]
        self._bent = [(hand.joint[points] - 1) % 3 for points in self._points]

    def closed(self, given: np.ndarray, moves: np.ndarray, press_m: float) -> Closing:
        """Close the digits [5] that may move, from angles [15, 3] rad, but for those that press as they are to."""
        held = moves & self._held(given, press_m)
        bends = moves & ~held
        fingers = self._closed(Closing(given, held), bends & _FINGERS, ~bends)
        return self._closed(fingers, bends & _THUMB, ~_THUMB)

    def _held(self, given: np.ndarray, press_m: float) -> np.ndarray:
        """Tell which digits [5] press about as deep as is wanted."""
        self._distances.move(self._hand.posed(given[None])[0])
        nearest = self._distances.signed_m[self._distances.nearest(self._points)]
        return np.abs(nearest + press_m) < _HELD_M

    def _closed(self, before: Closing, active: np.ndarray, obstacles: np.ndarray) -> Closing:
        """Close active digits [5] at once, on solids and on digits [5] that are obstacles."""
        start = self._opened(before.angles, active, obstacles)
        angles, touches, goal = start, before.touches.copy(), _fist(start)
        lead, share = np.zeros(5, int), np.zeros(5)  # the first joint that still bends; of the way to the fist
        for _ in range(_MOST_STEPS):
            if not active.any():
                break
            self._distances.move(vertices := self._hand.posed(angles[None])[0])
            free_m, phalanx = self._free_ways(lead, active)
            hits = active & (free_m <= _TOUCH_M)
            touches |= hits
            own_m, own_phalanx = self._own_ways(vertices, lead, active, obstacles)
            is_own = active & (own_m < free_m)
            free_m, phalanx = np.where(is_own, own_m, free_m), np.where(is_own, own_phalanx, phalanx)
            hits = active & (free_m <= _TOUCH_M)
            lead = np.where(hits, np.maximum(phalanx, lead) + 1, lead)
            active = active & (lead <= 2)
            step = np.maximum(_STRIDE * free_m / np.maximum(_rates(self._hand, start, goal, lead), 1e-6), _LEAST_STEP)
            step = np.where(active & ~hits, np.minimum(step, 1 - share), 0)
            share += step
            angles = _with_last_joints(_advanced(angles, start, goal, lead, step), start)
            active &= (share < 1 - 1e-9) | hits
        return Closing(angles, touches)

    def _opened(self, given: np.ndarray, active: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
        """Open digits that are deep in a thing or an obstacle, by the smallest of some ways: to spread, or sideways."""
        start, sought, least_m = given.copy(), active.copy(), np.full(5, -np.inf)
        for way in self._ways(given):
            self._distances.move(vertices := self._hand.posed(way[None])[0])
            no_lead = np.zeros(5, int)
            free_m = self._free_ways(no_lead, sought)[0]
            free_m = np.minimum(free_m, self._own_ways(vertices, no_lead, sought, obstacles)[0])
            is_better = np.repeat(sought & (free_m > least_m), 3)
            start[is_better] = way[is_better]
            least_m = np.where(sought, np.maximum(least_m, free_m), least_m)
            sought &= free_m < (-_SLIGHT_M if way is given else 0)
            if not sought.any():
                break
        return start

    def _ways(self, given: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the angles given, and then those that lead away from them, farther and farther."""
        yield given
        spread = np.minimum(given, np.deg2rad(GESTURES["spread"].angles_deg()))[:, 0]
        for sideways in _SIDEWAYS_RAD:
            for share in _OPENINGS:
                way = given.copy()
                way[:, 0] += share * (spread - given[:, 0])
                way[::3, 1] = np.clip(given[::3, 1] + sideways, *self._hand.limits_rad[::3, :, 1].T)
                yield way

    def _free_ways(self, lead: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Measure how far the phalanges from the leading joints on are from a thing [5], and the nearest's number."""
        free_m, phalanx = np.full(5, np.inf), np.zeros(5, int)
        digits = np.flatnonzero(active)
        points = [self._points[digit][self._bent[digit] >= lead[digit]] for digit in digits]
        nearest = self._distances.nearest(points)
        free_m[digits], phalanx[digits] = self._distances.signed_m[nearest], (self._hand.joint[nearest] - 1) % 3
        return free_m, phalanx

    def _own_ways(
        self, vertices: np.ndarray, lead: np.ndarray, active: np.ndarray, obstacles: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Measure, as `_free_ways`, how far they are from digits that are obstacles, at most `_NEAR_M`."""
        free_m, phalanx = np.full(5, _NEAR_M if obstacles.any() else np.inf), np.zeros(5, int)
        if not (active.any() and obstacles.any()):
            return free_m, phalanx
        found = self._own.contacts(vertices, _NEAR_M, active, obstacles)
        for digit in np.flatnonzero(active):
            mine = np.where(self._hand.digit[found.points] == digit, found.points, found.others)
            joint = self._hand.joint[mine]
            which = np.flatnonzero((self._hand.digit[mine] == digit) & (joint > 3 * digit + lead[digit]))
            if len(which):
                nearest = which[found.gap_m[which].argmin()]
                free_m[digit], phalanx[digit] = found.gap_m[nearest], (joint[nearest] - 1) % 3
        return free_m, phalanx


def _fist(start: np.ndarray) -> np.ndarray:
    """Return the angles of a fist, but where a joint is bent more already."""
    goal = start.copy()
    goal[:, 0] = np.maximum(start[:, 0], np.deg2rad(GESTURES["fist"].angles_deg()[:, 0]))
    return goal


def _with_last_joints(angles: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return angles [15, 3] rad whose fingers' last joints are bent at most as those before them allow, or as given."""
    flexion, most = angles[:12, 0].reshape(4, 3), start[2:12:3, 0]
    angles = angles.copy()
    angles[2:12:3, 0] = np.minimum(flexion[:, 2], np.maximum(_LAST_SHARE * flexion[:, 1] + _LAST_SLACK_RAD, most))
    return angles


def _rates(hand: ContactHand, start: np.ndarray, goal: np.ndarray, lead: np.ndarray) -> np.ndarray:
    """Bound how far [5] m a digit's points move on the whole way."""
    way = (np.abs(goal - start).sum(1) * hand.lengths_m).reshape(5, 3)
    return (way * (np.arange(3) >= lead[:, None])).sum(1)


def _advanced(
    angles: np.ndarray, start: np.ndarray, goal: np.ndarray, lead: np.ndarray, step: np.ndarray
) -> np.ndarray:
    bends = (np.arange(3) >= lead[:, None]).reshape(15, 1)
    return angles + np.repeat(step, 3)[:, None] * bends * (goal - start)
