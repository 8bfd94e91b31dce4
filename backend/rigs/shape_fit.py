"""Fits beta and scale of a hand model to the lengths of another rig's bones and palm, by bounded least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..hand.model import MIRROR_POINT, HandModel
from ..motion.landmarks.bone_lengths import BONES, PALM_PAIRS, TIP_BONES
from ..motion.landmarks.skeleton import HandSkeleton

# Pairs of the 21 nodes at a fixed distance. Where a rig's tips are differs, so they count little.
_PAIRS = np.array([*BONES, *PALM_PAIRS, *TIP_BONES])
_TIP_WEIGHT = 0.3
_WEIGHTS = np.r_[np.ones(len(BONES) + len(PALM_PAIRS)), np.full(len(TIP_BONES), _TIP_WEIGHT)]
# One unit of beta costs as much as an error of this share of the mean length. The first with which no beta is unnatural
# is taken: little for a hand of the model's shapes, more for one that is unlike any of them.
_PRIORS = (0.004, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2)
_NATURAL_BETA = 3.8
MOST_BETA = 4.0
"""Bound of a fitted shape's betas."""
_STEPS = 12
_STEP_BETA = 1e-4  # of the finite differences
_SWEEPS = 30  # of the bounded solve, over all betas


class HandShape(NamedTuple):
    """A shape beta [10] and the scale of a hand of that shape."""

    beta: np.ndarray
    scale: float


def rest_nodes(model: HandModel, beta: np.ndarray) -> np.ndarray:
    """Return [21, 3] m the nodes of a shape at rest in the template's frame."""
    skeleton = HandSkeleton.of(model)
    nodes = skeleton.rest + skeleton.shape @ beta
    return nodes if model.side == "right" else nodes * MIRROR_POINT


def fit_shape(model: HandModel, nodes: np.ndarray) -> HandShape:
    """Fit a shape to another hand's nodes [21, 3] m in any rest pose, NaN for those that are unknown (Gauss-Newton).

    The shape of a hand that is unlike any of the model's stays natural, and does not fit well.
    """
    skeleton, wanted = HandSkeleton.of(model), _lengths(nodes)
    *weaker, strongest = _PRIORS
    for prior in weaker:
        shape = _fit(skeleton, wanted, prior)
        if np.abs(shape.beta).max() < _NATURAL_BETA:
            return shape
    return _fit(skeleton, wanted, strongest)


def _fit(skeleton: HandSkeleton, wanted: np.ndarray, prior: float) -> HandShape:
    """Fit the shape whose lengths are nearest to those wanted [P], NaN for unknown ones."""
    known = np.isfinite(wanted)
    weights = _WEIGHTS[known]
    wanted = wanted[known] * weights

    def lengths(beta: np.ndarray) -> np.ndarray:
        return _lengths(skeleton.rest + skeleton.shape @ beta)[known] * weights

    beta, scale = np.zeros(10), _scale(lengths(np.zeros(10)), wanted)
    cost = (prior * lengths(beta).mean()) ** 2 * np.eye(10)
    for _ in range(_STEPS):
        now = lengths(beta)
        jacobian = np.stack([lengths(beta + step) - now for step in _STEP_BETA * np.eye(10)], 1) / _STEP_BETA
        # The scale is free, so the part of each column that changes the size only is projected out.
        jacobian -= np.outer(now, now @ jacobian) / (now @ now)
        residual = wanted / scale - now
        beta = _bounded_solution(jacobian.T @ jacobian + cost, jacobian.T @ (residual + jacobian @ beta), beta)
        scale = _scale(lengths(beta), wanted)
    return HandShape(beta, scale)


def _bounded_solution(matrix: np.ndarray, right: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Minimise x.matrix.x / 2 - right.x for x within +-`MOST_BETA` (Gauss-Seidel with projection)."""
    x = np.clip(start, -MOST_BETA, MOST_BETA)
    for _ in range(_SWEEPS):
        for k in range(len(x)):
            x[k] = np.clip(x[k] + (right[k] - matrix[k] @ x) / matrix[k, k], -MOST_BETA, MOST_BETA)
    return x


def _lengths(nodes: np.ndarray) -> np.ndarray:
    return np.linalg.norm(nodes[_PAIRS[:, 0]] - nodes[_PAIRS[:, 1]], axis=1)


def _scale(own: np.ndarray, wanted: np.ndarray) -> float:
    return float(own @ wanted / (own @ own))
