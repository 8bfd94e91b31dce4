"""Fits the pose and shape of a hand to points that its vertices should lie on, by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...hand.lbs import SkinTensors, pose_hand
from ...records.shot import HandPose

_THETA, _BETA = 48, 10  # numbers of a pose and of a shape, before the 3 of the translation
_ROUNDING_MM = 1e-4  # of the least step that counts
_STEP = 1e-6  # of the differences
_DAMPING, _MOST_DAMPING = 1e-3, 1e6


class PointGoals(NamedTuple):
    """Where vertices of a hand should lie.

    Attributes:
        vertex: [N] of the hand.
        points: [N, 3] m, world.
        normals: [N, 3] unit, along which being off counts fully.
        weight: [N].
        across: by which being off across the normals counts less, from 0 to 1.
        offset_m: [N, 3] of the surface from the model's own vertices, world.
        joints: [16, 3] m, world, near which the joints are; None: not known.
    """

    vertex: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    weight: np.ndarray
    across: float = 1.0
    offset_m: np.ndarray | float = 0.0
    joints: np.ndarray | None = None


class FitPrior(NamedTuple):
    """How far a fit may go.

    Attributes:
        point_mm: deviation of points.
        joint_mm: of joints.
        theta_rad: of the fingers' angles from where they start.
        beta: of the shape from zero; 0: the shape stays.
        share: of the points' number that the priors weigh against.
    """

    point_mm: float = 1.0
    joint_mm: float = 3.0
    theta_rad: float = 0.2
    beta: float = 1.5
    share: float = 0.02


def fitted_to_points(
    skin: SkinTensors, start: HandPose, goals: PointGoals, prior: FitPrior, steps: int = 8
) -> HandPose:
    """Fit a pose, its translation and, if the prior allows, its shape; the forearm stays.

    Args:
        skin: of the pose's side, float64.
        start: near the goal.
        goals: of vertices.
        prior: of the fit.
        steps: at most.
    """
    residual = _residual(skin, start, goals, prior)
    x = torch.as_tensor(np.concatenate([start.theta.ravel(), start.beta, start.transl]))
    is_free = torch.ones(len(x), dtype=torch.bool)
    is_free[_THETA : _THETA + _BETA] = prior.beta > 0
    now, damping = residual(x), _DAMPING
    for _ in range(steps):
        jacobian = (residual(x + _STEP * torch.eye(len(x), dtype=x.dtype)[is_free]) - now).T / _STEP
        square, slope = jacobian.T @ jacobian, jacobian.T @ now
        while damping < _MOST_DAMPING:
            damped = square + damping * torch.diag(square.diagonal().clamp(min=1e-12))
            step = torch.zeros_like(x)
            step[is_free] = -torch.linalg.solve(damped, slope)
            then = residual(x + step)
            if then.square().sum() < now.square().sum():
                break
            damping *= 10
        else:
            break
        gain = float(now.square().sum() - then.square().sum())
        x, now, damping = x + step, then, damping / 10
        if gain < _ROUNDING_MM * float(now.square().sum()):
            break
    values = x.numpy()
    theta, beta, transl = values[:_THETA].reshape(16, 3), values[_THETA:-3], values[-3:]
    return replace(start, theta=theta, beta=beta, transl=transl)


def _residual(skin: SkinTensors, start: HandPose, goals: PointGoals, prior: FitPrior) -> Callable[[Tensor], Tensor]:
    """Return the function of the parameters [..., 61] whose squares are minimised."""
    vertex = torch.as_tensor(goals.vertex)
    points, normals, weight = (torch.as_tensor(values) for values in (goals.points, goals.normals, goals.weight))
    points = points - torch.as_tensor(goals.offset_m)
    scale = (1000 / prior.point_mm * (weight / (prior.share * weight.sum())).sqrt())[:, None]
    first = torch.as_tensor(start.theta)
    joints = None if goals.joints is None else torch.as_tensor(goals.joints)
    forearm = torch.as_tensor(start.forearm)

    def residual(x: Tensor) -> Tensor:
        theta, beta, transl = x[..., :_THETA].unflatten(-1, (16, 3)), x[..., _THETA:-3], x[..., -3:]
        posed = pose_hand(skin, theta, beta, transl, forearm.expand_as(transl))
        off = posed.vertices[..., vertex, :] - points
        along = (off * normals).sum(-1, keepdim=True)
        rest = goals.across * (off - along * normals)
        moved = (theta - first)[..., 1:, :] / prior.theta_rad
        parts = [(scale * along).flatten(-2), (scale * rest).flatten(-2), moved.flatten(-2)]
        if joints is not None:
            parts.append(((posed.joints - joints) * (1000 / prior.joint_mm)).flatten(-2))
        return torch.cat(parts + ([beta / prior.beta] if prior.beta > 0 else []), -1)

    return residual
