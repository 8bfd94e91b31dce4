"""The shape and the size of our hand whose bones are as long as another rig's: least squares on distances of joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..hand.model import MIRROR_POINT, HandModel
from ..motion.landmarks.skeleton import HandSkeleton

NODES = 21  # the wrist, and three joints and the tip of each finger, in MANO's order
_KNUCKLES = (1, 5, 9, 13)
_THUMB = 17
# What is rigid: every finger's bones, and the palm with the thumb's root.
_PALM = (0, *_KNUCKLES, _THUMB)
_PAIRS = np.array(
    [(4 * finger + k, 4 * finger + k + 1) for finger in range(5) for k in (1, 2, 3)]
    + [(a, b) for row, a in enumerate(_PALM) for b in _PALM[row + 1 :]]
)
# A unit of beta costs as much as missing a length by this share of the hand's size.
_SHYNESS = 0.004
_MOST_BETA = 4.0
_STEPS = 12
_NUDGE = 1e-4


class HandShape(NamedTuple):
    """A shape beta [10], and the factor that a hand of that shape is scaled by."""

    beta: np.ndarray
    scale: float


def rest_nodes(model: HandModel, beta: np.ndarray) -> np.ndarray:
    """[21, 3] m of a hand's shape in the template's frame."""
    skeleton = HandSkeleton.of(model)
    nodes = skeleton.rest + skeleton.shape @ beta
    return nodes if model.side == "right" else nodes * MIRROR_POINT


def fit_shape(model: HandModel, nodes: np.ndarray) -> HandShape:
    """Shape and size after another hand's nodes [21, 3] in any rest pose; NaN where a tip is not known."""
    skeleton = HandSkeleton.of(model)
    wanted = _lengths(nodes)
    known = np.isfinite(wanted)
    wanted = wanted[known]

    def lengths(beta: np.ndarray) -> np.ndarray:
        return _lengths(skeleton.rest + skeleton.shape @ beta)[known]

    beta, scale = np.zeros(10), _scale(lengths(np.zeros(10)), wanted)
    shyness = _SHYNESS * lengths(beta).mean()
    for _ in range(_STEPS):
        now = lengths(beta)
        slope = np.stack([lengths(beta + step) - now for step in _NUDGE * np.eye(10)], 1) / _NUDGE
        # The size is free: what a change of shape does to it is taken out.
        slope -= np.outer(now, now @ slope) / (now @ now)
        rest = wanted / scale - now
        beta = np.linalg.solve(slope.T @ slope + shyness**2 * np.eye(10), slope.T @ (rest + slope @ beta))
        beta = np.clip(beta, -_MOST_BETA, _MOST_BETA)
        scale = _scale(lengths(beta), wanted)
    return HandShape(beta, scale)


def _lengths(nodes: np.ndarray) -> np.ndarray:
    return np.linalg.norm(nodes[_PAIRS[:, 0]] - nodes[_PAIRS[:, 1]], axis=1)


def _scale(own: np.ndarray, wanted: np.ndarray) -> float:
    return float(own @ wanted / (own @ own))
