"""Fits the joint regressor: non-negative local weights that fit the template and its shape directions."""

from __future__ import annotations

import numpy as np

from ...backend.teacher.dependencies import needs
from .shape_directions import ShapeDirections

with needs("scipy"):
    from scipy.optimize import nnls

_WRIST_VERTICES, _JOINT_VERTICES = 160, 70  # number of nearest vertices with a weight
_SUM_STRENGTH = 30.0  # of the equation that the weights sum to 1; the others are in mm
_SPREAD_STRENGTH = 0.6  # of the regularisation, which spreads the weights


def joint_regressor(vertices: np.ndarray, joints: np.ndarray, directions: ShapeDirections) -> np.ndarray:
    """Solve for [16, V], rows of sum 1, from vertices [V, 3] to joints [16, 3] for any beta, by least squares in mm."""
    regressor = np.zeros((len(joints), len(vertices)))
    for joint in range(len(joints)):
        distance = np.linalg.norm(vertices - joints[joint], axis=1)
        near = np.argsort(distance)[: _WRIST_VERTICES if joint == 0 else _JOINT_VERTICES]
        offsets = vertices[near] - joints[joint]
        drifts = directions.vertices[near] - directions.joints[joint]  # [n, 3, 10]
        weights = _weights(offsets, drifts)
        regressor[joint, near] = weights / weights.sum()
    return regressor


def _weights(offsets: np.ndarray, drifts: np.ndarray) -> np.ndarray:
    """Solve for [n] >= 0 with sum about 1 and weighted means of about 0 of offsets [n, 3] and drifts [n, 3, 10]."""
    count = len(offsets)
    rows = [
        offsets.T,
        np.full((1, count), _SUM_STRENGTH),
        drifts.transpose(2, 1, 0).reshape(-1, count),
        np.eye(count) * _SPREAD_STRENGTH,
    ]
    goal = np.zeros(sum(len(row) for row in rows))
    goal[3] = _SUM_STRENGTH
    weights, _ = nnls(np.vstack(rows), goal)
    return weights
