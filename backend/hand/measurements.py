"""The length and breadth of a hand, and the shape with given measurements."""

from __future__ import annotations

import numpy as np

from ..records.errors import LiveHandError
from .model import HandModel

_MIDDLE, _KNUCKLES = (4, 5, 6), (1, 4, 10, 7)
_STEPS = 8
# One unit of beta costs as much as an error of this in a measurement.
_PRIOR_M = 1e-4


def length_and_breadth_m(model: HandModel, beta: np.ndarray) -> np.ndarray:
    """Measure [2] m of the shape beta [10]: from the wrist joint to the straight middle fingertip, across the knuckles.

    The breadth is that of the skin from index to little finger, in a slice of the template around the knuckles.
    """
    vertices = model.v_template + model.shapedirs @ beta
    joints = model.J_regressor @ vertices
    tip = vertices[_fingertip(model)]
    chain = np.array([joints[0], *joints[list(_MIDDLE)], tip])
    across = vertices[_knuckle_slice(model)] @ _across(model)
    return np.array([np.linalg.norm(np.diff(chain, axis=0), axis=1).sum(), np.ptp(across)])


def fit_beta(model: HandModel, length_m: float, breadth_m: float, near: np.ndarray | None = None) -> np.ndarray:
    """Fit the shape [10] with these measurements that is nearest to a shape, or to the mean one (Gauss-Newton).

    Raises:
        LiveHandError: the model has no shapes.
    """
    check_has_shapes(model)
    prior = np.zeros(10) if near is None else near
    beta, wanted = prior, np.array([length_m, breadth_m])
    for _ in range(_STEPS):
        now, slope = length_and_breadth_m(model, beta), measurement_slopes(model, beta)
        residual = wanted - now + slope @ (beta - prior)
        beta = prior + slope.T @ np.linalg.solve(slope @ slope.T + _PRIOR_M**2 * np.eye(2), residual)
    return beta


def measurement_slopes(model: HandModel, beta: np.ndarray) -> np.ndarray:
    """Compute the derivatives [2, 10] m of length and breadth of a shape [10]."""
    now = length_and_breadth_m(model, beta)
    return np.stack([length_and_breadth_m(model, beta + step) - now for step in 1e-4 * np.eye(10)], 1) / 1e-4


def check_has_shapes(model: HandModel) -> None:
    """Raise `LiveHandError` if the model has no shape directions, as a model made from a user's mesh."""
    if not model.shapedirs.any():
        raise LiveHandError(
            f"a hand must have shape directions to change its shape, '{model.name}' has none; scale or sculpt its "
            "mesh, and make a hand model of that"
        )


def _fingertip(model: HandModel) -> int:
    own = np.flatnonzero(model.lbs_weights.argmax(1) == _MIDDLE[-1])
    return int(own[np.linalg.norm(model.v_template[own] - model.joints[_MIDDLE[-1]], axis=1).argmax()])


def _across(model: HandModel) -> np.ndarray:
    across = model.joints[_KNUCKLES[0]] - model.joints[_KNUCKLES[-1]]
    return across / np.linalg.norm(across)


def _knuckle_slice(model: HandModel) -> np.ndarray:
    """Find vertices within 8 mm of the knuckles along the hand, without the thumb."""
    along = model.joints[_MIDDLE[0]] - model.joints[0]
    along = along / np.linalg.norm(along)
    middle = model.joints[list(_KNUCKLES)].mean(0)
    is_thumb = model.lbs_weights[:, 13:].sum(1) > 0.3
    return np.flatnonzero((np.abs((model.v_template - middle) @ along) < 0.008) & ~is_thumb)
