"""A joint regressor: joints as weighted sums of the vertices around them."""

from __future__ import annotations

import numpy as np

from ...records.errors import LiveHandError

_LEAST_VERTICES = 24  # with a weight
_EXACT_M = 1e-9


def joint_regressor(vertices: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Solve for [16, V], rows of sum 1 that give the joints exactly, of least norm on the vertices nearest to each.

    Args:
        vertices: [V, 3] m.
        joints: [16, 3] m.

    Raises:
        LiveHandError: all vertices lie in one plane and a joint outside it.
    """
    return np.array([_row(vertices, joint) for joint in joints])


def _row(vertices: np.ndarray, joint: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(vertices - joint, axis=1)
    order, count = np.argsort(distance, kind="stable"), _LEAST_VERTICES
    while True:
        near = order[:count]
        weights = _weights(vertices[near] - joint)
        if np.linalg.norm(weights @ vertices[near] - joint) < _EXACT_M:
            row = np.zeros(len(vertices))
            row[near] = weights
            return row
        if count >= len(vertices):
            raise LiveHandError(
                "a hand must have a volume, got vertices that all lie in one plane; choose its own mesh"
            )
        count *= 2


def _weights(offsets: np.ndarray) -> np.ndarray:
    """Solve for weights [n] of least norm, with sum 1 and a weighted mean offset of 0."""
    size = np.linalg.norm(offsets, axis=1).max()
    rows = np.vstack([np.ones(len(offsets)), offsets.T / size])
    weights, *_ = np.linalg.lstsq(rows, np.array([1.0, 0, 0, 0]), rcond=None)
    return weights
