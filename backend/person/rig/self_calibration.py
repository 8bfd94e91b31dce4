"""Finds cameras of a rig that have been moved since they were calibrated, by the hands that they show.

Every camera may turn about its own centre: a redescending prior holds tilt and pan, so that a camera that was knocked
is let go, and roll is held tightly. Turns and the hands' landmarks are found together by iteratively re-weighted
Gauss-Newton steps; cameras that are held out are turned to the finished landmarks.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...geometry.rotation import axis_angle_to_matrix
from ...records.camera import Camera
from .association import AssociatedHand
from .rig_cameras import REDESCENDS_AT, ROLL_RAD, TILT_PAN_RAD

OFF_PX = 5.0
"""A camera is off if its turn moves the middle of its picture farther."""
_NOISE = 0.012  # of a landmark, as a share of the hand's size in the picture
_KERNEL = 5 / 3  # of that noise: the scale of the robust kernel, c^2 log(1 + r^2 / c^2)
_STEPS = 40
_ENOUGH = 1e-9  # relative fall of the cost that ends the search
_DEVIATIONS = np.array([TILT_PAN_RAD, TILT_PAN_RAD, ROLL_RAD])


@dataclass(frozen=True)
class Calibration:
    """Turns of all cameras, and what they were found by.

    Attributes:
        turns: [C, 3] rad, as `rig_cameras` has them.
        points: [S, 21, 3] m, world: landmarks of each hand.
        error_px: [C] median distance of the landmarks from where they are projected; NaN without any.
    """

    turns: np.ndarray
    points: np.ndarray
    error_px: np.ndarray


def cameras_off_px(turns: Float[np.ndarray, "C 3"], cameras: Sequence[Camera]) -> dict[int, float]:
    """List the rows of cameras that are off, with how far the middle of their picture moves, px."""
    focal_px = np.array([camera.K.diagonal()[:2].mean() for camera in cameras])
    moved_px = np.linalg.norm(turns[:, :2], axis=1) * focal_px
    return {row: float(moved_px[row]) for row in np.flatnonzero(moved_px > OFF_PX).tolist()}


def calibrated(
    hands: Sequence[AssociatedHand], cameras: Sequence[Camera], held_out: Collection[int] = ()
) -> Calibration:
    """Find the cameras' turns and the hands' landmarks.

    Args:
        hands: one or more, with their finds.
        cameras: as their files have them.
        held_out: rows of cameras that may not move the landmarks.
    """
    finds = _Finds.of(hands, cameras)
    is_held_out = np.isin(finds.view, list(held_out))
    points = np.stack([hand.points for hand in hands])
    turns = _turned_at_first(finds, points)
    turns[sorted(held_out)] = 0
    turns, points = _bundle(finds.at(~is_held_out), turns, points)
    for row in sorted(held_out):
        own = finds.at(finds.view == row)
        if len(own.view):
            start = np.zeros_like(turns)
            start[row] = _turned_at_first(own, points)[row]
            turns[row] = _bundle(own, start, points, moves_points=False)[0][row]
    off = np.linalg.norm(finds.residuals(turns, points)[0], axis=-1)
    own = [off[finds.view == row] for row in range(len(cameras))]
    return Calibration(turns, points, np.array([np.median(part) if part.size else np.nan for part in own]))


@dataclass(frozen=True)
class _Finds:
    """O finds: view [O], hand [O], px [O, 21, 2], noise_px [O], and the cameras of all views."""

    view: np.ndarray
    hand: np.ndarray
    px: np.ndarray
    noise_px: np.ndarray
    K: np.ndarray
    world2camera: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, hands: Sequence[AssociatedHand], cameras: Sequence[Camera]) -> _Finds:
        rows = [(find, number) for number, hand in enumerate(hands) for find in hand.finds]
        return cls(
            view=np.array([find.view for find, _ in rows]),
            hand=np.array([number for _, number in rows]),
            px=np.stack([find.px for find, _ in rows]),
            noise_px=np.array([_NOISE * find.size_px for find, _ in rows]),
            K=np.stack([camera.K for camera in cameras]),
            world2camera=np.stack([camera.cam2world[:3, :3].T for camera in cameras]),
            origin=np.stack([camera.origin for camera in cameras]),
        )

    def at(self, chosen: np.ndarray) -> _Finds:
        """Choose finds by a mask [O]."""
        own = (self.view[chosen], self.hand[chosen], self.px[chosen], self.noise_px[chosen])
        return _Finds(*own, self.K, self.world2camera, self.origin)

    def residuals(self, turns: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute residuals [O, 21, 2] px and their slopes by the turn and by the point, [O, 21, 2, 3] each."""
        rotation = (axis_angle_to_matrix(turns) @ self.world2camera)[self.view]
        at = (points[self.hand] - self.origin[self.view][:, None]) @ rotation.swapaxes(1, 2)  # in the camera
        K = self.K[self.view]
        homogeneous = at @ K.swapaxes(1, 2)
        px = homogeneous[..., :2] / homogeneous[..., 2:]
        by_at = (K[:, None, :2] - px[..., None] * K[:, None, 2:]) / homogeneous[..., 2:, None]  # [O, 21, 2, 3]
        by_turn = np.cross(at[..., None, :], by_at)  # by (turn x at) = (at x by_at) . turn
        return px - self.px, by_turn, by_at @ rotation[:, None]


def _turned_at_first(finds: _Finds, points: np.ndarray) -> np.ndarray:
    """Turn each camera by the median shift of its landmarks where that lowers its cost."""
    turns = np.zeros((len(finds.K), 3))
    shift_px = -finds.residuals(turns, points)[0]
    for row in np.unique(finds.view).tolist():
        x, y = np.median(shift_px[finds.view == row].reshape(-1, 2), 0) / finds.K[row].diagonal()[:2]
        turns[row, :2] = -y, x
        own, still = finds.at(finds.view == row), np.zeros_like(turns)
        if _cost(own, np.where(np.arange(len(turns))[:, None] == row, turns, 0), points) > _cost(own, still, points):
            turns[row] = 0
    return turns


def _cost(finds: _Finds, turns: np.ndarray, points: np.ndarray) -> float:
    squared = (finds.residuals(turns, points)[0] ** 2).sum(-1) / (finds.noise_px[:, None] * _KERNEL) ** 2
    tilt_pan, roll = (turns[:, :2] / TILT_PAN_RAD) ** 2, (turns[:, 2] / ROLL_RAD) ** 2
    prior = (tilt_pan / (1 + tilt_pan / REDESCENDS_AT**2)).sum() + roll.sum()
    return float(_KERNEL**2 * np.log1p(squared).sum() + prior)


def _bundle(
    finds: _Finds, turns: np.ndarray, points: np.ndarray, moves_points: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Lower the cost by Levenberg-Marquardt steps; a step that raises it is not taken."""
    cost, damping = _cost(finds, turns, points), 1e-3
    for _ in range(_STEPS):
        turn_step, point_step = _step(finds, turns, points, damping, moves_points)
        new_turns, new_points = turns + turn_step, points + point_step
        new_cost = _cost(finds, new_turns, new_points)
        if new_cost > cost:
            damping *= 10
            continue
        is_enough = cost - new_cost < _ENOUGH * cost
        turns, points, cost, damping = new_turns, new_points, new_cost, damping / 5
        if is_enough:
            break
    return turns, points


def _step(
    finds: _Finds, turns: np.ndarray, points: np.ndarray, damping: float, moves_points: bool
) -> tuple[np.ndarray, np.ndarray]:
    residual, by_turn, by_point = finds.residuals(turns, points)
    squared = (residual**2).sum(-1) / (finds.noise_px[:, None] * _KERNEL) ** 2
    root = 1 / np.sqrt(1 + squared) / finds.noise_px[:, None]  # [O, 21], of the weights
    columns = turns.size + (points.size if moves_points else 0)
    jacobian = np.zeros((*residual.shape, columns))
    for row, (view, hand) in enumerate(zip(finds.view, finds.hand, strict=True)):
        jacobian[row, :, :, 3 * view : 3 * view + 3] = by_turn[row]
        if moves_points:
            for node in range(21):
                first = turns.size + 3 * (21 * hand + node)
                jacobian[row, node, :, first : first + 3] = by_point[row, node]
    jacobian = (jacobian * root[..., None, None]).reshape(-1, columns)
    normal = jacobian.T @ jacobian
    right = -jacobian.T @ (residual * root[..., None]).reshape(-1)
    shares = turns / _DEVIATIONS
    weight = np.ones_like(shares)
    weight[:, :2] = 1 / (1 + shares[:, :2] ** 2 / REDESCENDS_AT**2) ** 2
    diagonal = np.einsum("kk->k", normal)
    diagonal[: turns.size] += (weight / _DEVIATIONS**2).reshape(-1)
    right[: turns.size] -= (weight * turns / _DEVIATIONS**2).reshape(-1)
    diagonal += damping * diagonal + 1e-12
    step = np.linalg.solve(normal, right)
    point_step = step[turns.size :].reshape(points.shape) if moves_points else np.zeros_like(points)
    return step[: turns.size].reshape(turns.shape), point_step
