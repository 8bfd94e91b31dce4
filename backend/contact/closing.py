"""Bends the digits from a pose towards a fist until they touch: proximal joints stop first, the others go on.

Steps are no longer than the way that is free (conservative advancement), so that no digit jumps through a thin thing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..hand.gestures import GESTURES
from .contact_hand import ContactHand
from .placed_solids import Solids
from .point_distances import PointDistances

_TOUCH_M = 0.0003
_LEAST_STEP = 0.004  # of the way to the fist
_MOST_STEPS = 60
_OPENINGS = np.linspace(0, 1, 9)[1:]
_SLIGHT_M = 0.004  # depth of a digit that is pushed out rather than opened


@dataclass(frozen=True)
class Closing:
    """Angles [15, 3] rad in which the digits touch or are closed, and [5] which digits touch."""

    angles: np.ndarray
    touches: np.ndarray


def closed(hand: ContactHand, given: np.ndarray, solids: Solids, moves: np.ndarray) -> Closing:
    """Close the digits [5] that may move on solids, from angles [15, 3] rad; the solids are in the wrist's frame."""
    depth_m = -_least_m(hand, given[None], solids)[0]
    start = _opened(hand, given, solids, moves & (depth_m > _SLIGHT_M))
    is_near = (depth_m > -_TOUCH_M) & (depth_m <= _SLIGHT_M)
    angles, touches, active = start, is_near.copy(), moves & ~is_near
    distances, goal = PointDistances(hand, solids), _fist(start)
    lead, share = np.zeros(5, int), np.zeros(5)  # the first joint of each digit that still bends; of the way to a fist
    for _ in range(_MOST_STEPS):
        if not active.any():
            break
        distances.move(hand.posed(angles[None])[0])
        free_m, phalanx = _free_ways(hand, distances, lead, active)
        hits = active & (free_m <= _TOUCH_M)
        touches |= hits
        lead = np.where(hits, phalanx + 1, lead)
        active &= lead <= 2
        step = np.maximum(free_m / np.maximum(_rates(hand, start, goal, lead), 1e-6), _LEAST_STEP)
        step = np.where(active & ~hits, np.minimum(step, 1 - share), 0)
        share += step
        angles = _advanced(angles, start, goal, lead, step)
        active &= (share < 1 - 1e-9) | hits
    return Closing(angles, touches)


def _free_ways(
    hand: ContactHand, distances: PointDistances, lead: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Measure how far the phalanges from the leading joints on are from a thing [5], and the nearest's number."""
    free_m, phalanx = np.full(5, np.inf), np.zeros(5, int)
    for digit in np.flatnonzero(active):
        own = np.flatnonzero((hand.digit == digit) & (hand.joint > 3 * digit + lead[digit]))
        nearest = distances.nearest(own)
        free_m[digit], phalanx[digit] = distances.signed_m[nearest], (hand.joint[nearest] - 1) % 3
    return free_m, phalanx


def _least_m(hand: ContactHand, angles: np.ndarray, solids: Solids) -> np.ndarray:
    """Measure the least distance [B, 5] of each digit's vertices in angles [B, 15, 3]."""
    vertices = hand.posed(angles)
    signed = solids.distances(vertices.reshape(-1, 3)).signed_m.reshape(vertices.shape[:2])
    digit = hand.digit[: signed.shape[1]]
    return np.stack([signed[:, digit == one].min(1) for one in range(5)], 1)


def _opened(hand: ContactHand, given: np.ndarray, solids: Solids, deep: np.ndarray) -> np.ndarray:
    """Open digits [5] that are deep in a thing, by the smallest of some shares of the way to the spread hand."""
    if not deep.any():
        return given
    spread = given.copy()
    spread[:, 0] = np.minimum(given[:, 0], np.deg2rad(GESTURES["spread"].angles_deg()[:, 0]))
    ways = given + _OPENINGS[:, None, None] * (spread - given)
    least = _least_m(hand, ways, solids)
    start = given.copy()
    for digit in np.flatnonzero(deep):
        free = np.flatnonzero(least[:, digit] > 0)
        best = free[0] if len(free) else least[:, digit].argmax()
        joints = slice(3 * digit, 3 * digit + 3)
        start[joints] = ways[best, joints]
    return start


def _fist(start: np.ndarray) -> np.ndarray:
    """Return the angles of a fist, but where a joint is bent more already."""
    goal = start.copy()
    goal[:, 0] = np.maximum(start[:, 0], np.deg2rad(GESTURES["fist"].angles_deg()[:, 0]))
    return goal


def _rates(hand: ContactHand, start: np.ndarray, goal: np.ndarray, lead: np.ndarray) -> np.ndarray:
    """Bound how far [5] m a digit's points move on the whole way."""
    way = (np.abs(goal - start).sum(1) * hand.lengths_m).reshape(5, 3)
    return (way * (np.arange(3) >= lead[:, None])).sum(1)


def _advanced(
    angles: np.ndarray, start: np.ndarray, goal: np.ndarray, lead: np.ndarray, step: np.ndarray
) -> np.ndarray:
    bends = (np.arange(3) >= lead[:, None]).reshape(15, 1)
    return angles + np.repeat(step, 3)[:, None] * bends * (goal - start)
