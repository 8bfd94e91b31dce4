"""Moves the joints a little, so that digits which touch press lightly and nothing passes through anything.

Levenberg-Marquardt steps on the gaps, in which the joints' limits are bounds and the pose is held back to where it was.
Where that leaves gaps, it is held back less from there on: so a hand that has settled settles where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..hand.joint_limits import FREE
from .contact_hand import PALM, ContactHand
from .own_contacts import OwnContactSearch
from .point_distances import PointDistances

_STEPS = 20
_DIFFERENCE_RAD = np.deg2rad(0.5)
_LARGEST_STEP_RAD = np.deg2rad(6.0)
_SLACK_M = 0.0002  # one unit of cost for gaps
_EASE_RAD = np.deg2rad(np.array([*(10.0, 5.0, 10.0, 10.0) * 4, 10.0, 6.0, 6.0, 10.0, 10.0]))  # and for free angles
_OWN_DEPTH_M = 0.0003  # flesh yields a little where digits touch
_DIGIT = np.append(np.repeat(np.arange(4), 4), np.full(5, 4))  # of each free angle
_SLOT = np.append(np.tile(np.arange(4), 4), np.arange(5))  # its number within its digit
_REST_M = 0.00002  # gaps above which a hand is held back less
_LOOSENESS, _LOOSE_PASSES = 20.0, 2
_GOOD_M = 0.0003  # gaps are good that are nearer than this to what they should be
_ENOUGH, _STUCK = 0.05, 0.01  # least decrease of the cost in a step, as a share, with good gaps and without


@dataclass(frozen=True)
class Settling:
    """What is wanted of a pose.

    Attributes:
        reference: [15, 3] rad, which it stays near.
        looseness: how far from it joints move as readily as others move by `_EASE_RAD`.
        presses: [5] digits that are to touch.
        press_m: how deep.
        low: [21] smallest free angles, rad.
        high: [21] largest.
        moves: [5] digits that may move.
    """

    reference: np.ndarray
    presses: np.ndarray
    press_m: float
    low: np.ndarray
    high: np.ndarray
    moves: np.ndarray
    looseness: float = 1.0


class Settler:
    """Settles poses of one hand on solids in its wrist's frame."""

    def __init__(self, hand: ContactHand, distances: PointDistances, own: OwnContactSearch):
        """Take what is asked in every step."""
        self._hand, self._distances, self._own = hand, distances, own
        self._pads = [np.flatnonzero((hand.digit == digit) & hand.is_palmar) for digit in range(5)]
        self._candidates = np.flatnonzero(hand.digit != PALM)

    def settled(self, start: np.ndarray, wanted: Settling) -> np.ndarray:
        """Move angles [15, 3] rad until the gaps are as wanted, or become no better."""
        angles, rest_m = self._approached(start, wanted)
        for _ in range(_LOOSE_PASSES):
            if rest_m <= _REST_M:
                break
            angles, rest_m = self._approached(angles, replace(wanted, reference=angles, looseness=_LOOSENESS))
        return angles

    def _approached(self, start: np.ndarray, wanted: Settling) -> tuple[np.ndarray, float]:
        """Move angles [15, 3] rad near a reference; the second is the largest gap that is left, m."""
        angles, damping = start, 1e-2
        rows = self._rows(angles, wanted)
        for _ in range(_STEPS):
            tried = self._stepped(angles, rows, wanted, damping)
            new = self._rows(tried, wanted)
            if new.cost >= rows.cost:
                damping *= 10
                if damping > 1e3:
                    break
                continue
            is_done = new.cost > (1 - (_ENOUGH if new.gap_m < _GOOD_M else _STUCK)) * rows.cost
            angles, rows, damping = tried, new, damping / 5
            if is_done:
                break
        return angles, rows.gap_m

    def gaps_m(self, angles: np.ndarray) -> np.ndarray:
        """Measure how far [5] the palmar sides of the digits are from solids in angles [15, 3] rad."""
        self._distances.move(self._hand.posed(angles[None])[0])
        return self._distances.signed_m[self._distances.nearest(self._pads)]

    def has_deeper(self, angles: np.ndarray, depth_m: float) -> bool:
        """Tell whether a point of a digit is deeper in solids than a depth in angles [15, 3] rad."""
        self._distances.move(self._hand.posed(angles[None])[0])
        return bool(len(self._distances.below(-depth_m, self._candidates)))

    def _stepped(self, angles: np.ndarray, rows: _GapRows, wanted: Settling, damping: float) -> np.ndarray:
        slope = rows.slope
        normal = slope.T @ slope
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1.0), slope.T @ rows.residual)
        step *= min(1.0, _LARGEST_STEP_RAD / max(np.abs(step).max(), 1e-12))
        flat = angles.ravel().copy()
        flat[FREE] = np.clip(flat[FREE] + step * wanted.moves[_DIGIT], wanted.low, wanted.high)
        return flat.reshape(15, 3)

    def _rows(self, angles: np.ndarray, wanted: Settling) -> _GapRows:
        """Compute residuals and their slopes by the free angles."""
        vertices = self._hand.posed(angles[None])[0]
        object_rows = self._object_rows(vertices, angles, wanted)
        own_rows = self._own_rows(vertices, angles)
        ease_rad = wanted.looseness * _EASE_RAD
        offset = (angles - wanted.reference).ravel()[FREE] / ease_rad
        slopes = np.concatenate([object_rows[1], own_rows[1], np.diag(1 / ease_rad)])
        gaps = np.concatenate([object_rows[0], own_rows[0]])
        gap_m = float(np.abs(gaps).max(initial=0.0)) * _SLACK_M
        return _GapRows(np.concatenate([gaps, offset]), slopes, gap_m)

    def _object_rows(self, vertices: np.ndarray, angles: np.ndarray, wanted: Settling) -> tuple[np.ndarray, np.ndarray]:
        distances = self._distances
        distances.move(vertices)
        deep = distances.below(-wanted.press_m, self._candidates)
        pads = distances.nearest([self._pads[digit] for digit in np.flatnonzero(wanted.presses)])
        rows = np.unique(np.concatenate([deep, pads]))
        residual = (distances.signed_m[rows] + wanted.press_m) / _SLACK_M
        return residual, self._slopes(angles, rows, distances.outward[rows]) / _SLACK_M

    def _own_rows(self, vertices: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = self._own.contacts(vertices, -_OWN_DEPTH_M)
        both, outward = np.concatenate([found.points, found.others]), np.concatenate([found.outward, -found.outward])
        slopes = self._slopes(angles, both, outward).reshape(2, -1, len(FREE)).sum(0)
        return (found.gap_m + _OWN_DEPTH_M) / _SLACK_M, slopes / _SLACK_M

    def _slopes(self, angles: np.ndarray, points: np.ndarray, outward: np.ndarray) -> np.ndarray:
        """Compute [K, 21] how points move along unit vectors [K, 3], m per rad of the free angles of their digits."""
        if not len(points):
            return np.zeros((0, len(FREE)))
        at = self._hand.some_points(angles + _PERTURBATIONS, points)  # [6, K, 3], the first unchanged
        along = np.einsum("bkc,kc->kb", at[1:] - at[0], outward) / _DIFFERENCE_RAD  # [K, 5]
        return np.where(self._hand.digit[points][:, None] == _DIGIT, along[:, _SLOT], 0.0)


@dataclass(frozen=True)
class _GapRows:
    residual: np.ndarray
    slope: np.ndarray
    gap_m: float

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


def _perturbations() -> np.ndarray:
    """Return [6, 15, 3] rad: none, and the first to fifth free angle of every digit at once, which move no other."""
    changes = np.zeros((6, 45))
    changes[1 + _SLOT, FREE] = _DIFFERENCE_RAD
    return changes.reshape(6, 15, 3)


_PERTURBATIONS = _perturbations()
