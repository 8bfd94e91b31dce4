"""Poses of all pictures and one shape that bring the mesh's vertices where the pictures want them.

Levenberg and Marquardt's steps with the exact slopes of skinning. A picture tells of its own pose and of the shape, so
that poses are eliminated one by one (Schur's complement) and the shape's few equations are left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...hand.joint_axes import anatomical_axes
from ...hand.joint_limits import FREE
from ...hand.lbs import SkinTensors
from ...hand.lbs_slopes import BETA, FOREARM, THETA, TRANSL, VertexSubset, posed_part, vertex_slopes
from ...hand.model import HandModel
from ...records.hand_picture import HandPicture
from ...records.shot import HandPose
from .hand_size import LengthPrior
from .pose_targets import PoseTargets

_BENDS = slice(3, THETA.stop)  # of fingers' joints
_POSE = 54  # unknowns of a pose: theta, transl, forearm
_LARGE_PX = 4.0  # residuals beyond it count linearly
_OUTLINE_WEIGHT = 0.5
_THETA_WEIGHT, _BETA_WEIGHT, _TRANSL_M, _FOREARM_RAD = 6.0, 0.15, 0.04, 0.4
_HINGE_WEIGHT = 30.0  # of turns that fingers hardly have, rad^2
_MOST_STEPS, _LEAST_GAIN = 20, 1e-4
_FIRST_DAMPING = 1e-3


def fitted_poses(
    hand: HandModel,
    pictures: Sequence[HandPicture],
    targets: Sequence[PoseTargets],
    offsets_m: Sequence[np.ndarray],
    fits_shape: bool = True,
    length_m: float | None = None,
) -> list[HandPose]:
    """Fit the pose of each picture, and the shape of all.

    Args:
        hand: the model.
        pictures: with the poses to begin from. Those of one moment share their pose; held-out ones fit theirs alone.
        targets: of each picture.
        offsets_m: [V, 3] what the person's own shape adds to the posed vertices of each picture.
        fits_shape: move the shape, too.
        length_m: of the hand; None: not known.
    """
    first, pose_of = _poses_of(pictures)
    views = _views(hand, pictures, targets, offsets_m, pose_of)
    beta = torch.as_tensor(pictures[0].pose.beta, dtype=torch.float32)
    of_poses = [pictures[index] for index in first]
    start = Unknowns(torch.stack([_unknowns(picture.pose) for picture in of_poses]), beta)
    length = None if length_m is None else LengthPrior.of(hand, pictures[0].pose.beta, length_m)
    bends = torch.stack([_unknowns(picture.sighted or picture.pose)[_BENDS] for picture in of_poses])
    fit = _Fit(views, _Priors(start, bends, stiff_turns(hand), length), fits_shape)
    found = fit.solved(start)
    shape = found.beta.double().numpy()
    poses = [_pose(row, shape) for row in found.poses.double()]
    return [poses[row] for row in pose_of]


class Unknowns(NamedTuple):
    """Poses [P, 54] and the shape [10]."""

    poses: Tensor
    beta: Tensor


def stiff_turns(hand: HandModel) -> Tensor:
    """Return [S, 48]: of theta, the turns that hinges do not allow, to first order; all but `joint_limits.FREE`."""
    axes = torch.as_tensor(anatomical_axes(hand), dtype=torch.float32)
    is_stiff = torch.ones(45, dtype=torch.bool)
    is_stiff[torch.as_tensor(FREE)] = False
    return torch.nn.functional.pad(torch.block_diag(*axes), (3, 0))[is_stiff]


def robust(residual_px: Tensor) -> Tensor:
    """Halve the square of small residuals; grow linearly beyond `_LARGE_PX`."""
    return _LARGE_PX**2 * (torch.sqrt(1 + (residual_px / _LARGE_PX) ** 2) - 1)


def _trust(residual_px: Tensor) -> Tensor:
    """Return the slope of `robust` over the residual."""
    return 1 / torch.sqrt(1 + (residual_px / _LARGE_PX) ** 2)


@dataclass(frozen=True)
class _View:
    """What a picture wants of N of the vertices, of which it shows some, and M lie at its outline.

    Attributes:
        part: the vertices.
        offset_m: [N, 3].
        world2cam: [3, 4].
        K: [3, 3].
        px, weight: [N, 2] and [N] where they should be.
        reliability: [N, 2, 2] what takes of a distance from there what counts.
        row, edge_px, normal: [M], [M, 2], [M, 2] of the outline: its vertices' rows, and the edge.
        edge_weight: of each of the outline.
        pose: the row of its pose.
        tells_shape: whether the shape follows it.
    """

    part: VertexSubset
    offset_m: Tensor
    world2cam: Tensor
    K: Tensor
    px: Tensor
    weight: Tensor
    reliability: Tensor
    row: Tensor
    edge_px: Tensor
    normal: Tensor
    edge_weight: float
    pose: int
    tells_shape: bool

    def cost(self, unknowns: Unknowns) -> float:
        """Return the robust sum of what is missed."""
        pose = unknowns.poses[self.pose]
        vertices = posed_part(self.part, pose[THETA].view(16, 3), unknowns.beta, pose[TRANSL], pose[FOREARM])
        px = self._projected(vertices)[0]
        edge = ((px[self.row] - self.edge_px) * self.normal).sum(-1)
        inside = (self.weight * robust(self._off(px).norm(dim=-1))).sum()
        return float(inside + self.edge_weight * robust(edge).sum())

    def normal_equations(self, unknowns: Unknowns) -> tuple[Tensor, Tensor]:
        """Return matrix [64, 64] and gradient [64] in the pose and the shape, float64."""
        pose = unknowns.poses[self.pose]
        moved = vertex_slopes(self.part, pose[THETA].view(16, 3), unknowns.beta, pose[TRANSL], pose[FOREARM])
        px, per_m = self._projected(moved.vertices)
        slopes = per_m @ moved.slopes  # [N, 2, 64]
        off = self._off(px)
        weight = self.weight * _trust(off.norm(dim=-1))
        edge = ((px[self.row] - self.edge_px) * self.normal).sum(-1)
        edge_slopes = (self.normal[:, None] @ slopes[self.row])[:, 0]
        edge_weight = self.edge_weight * _trust(edge)
        rows = torch.cat([(self.reliability @ slopes).flatten(0, 1), edge_slopes])
        weights = torch.cat([weight.repeat_interleave(2), edge_weight])
        weighted = (rows * weights[:, None]).T
        return (weighted @ rows).double(), (weighted @ torch.cat([off.flatten(), edge])).double()

    def _off(self, px: Tensor) -> Tensor:
        """Return what counts [N, 2] of how far vertices at px [N, 2] are off."""
        return (self.reliability @ (px - self.px)[..., None])[..., 0]

    def _projected(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Return [N, 2] px of vertices [N, 3], and their slopes [N, 2, 3], px a metre."""
        turn, shift = self.world2cam[:, :3], self.world2cam[:, 3]
        homogeneous = ((vertices + self.offset_m) @ turn.T + shift) @ self.K.T
        depth = homogeneous[:, 2:]
        px = homogeneous[:, :2] / depth
        per_m = self.K @ turn
        return px, (per_m[:2] - px[..., None] * per_m[2]) / depth[..., None]


@dataclass(frozen=True)
class _Priors:
    """Poses and shape stay near where they begin, fingers turn about their hinges, and a known length is kept."""

    start: Unknowns
    bends: Tensor
    stiff: Tensor
    length: LengthPrior | None

    def of_poses(self, poses: Tensor) -> Tensor:
        """Return the mean cost of poses [P, 54]."""
        off = poses - self.start.poses
        cost = _THETA_WEIGHT * ((poses[..., _BENDS] - self.bends) ** 2).sum(-1)
        cost = cost + _HINGE_WEIGHT * ((poses[..., THETA] @ self.stiff.T) ** 2).sum(-1)
        cost = cost + 0.5 * ((off[..., TRANSL] / _TRANSL_M) ** 2).sum(-1)
        return (cost + 0.5 * ((off[..., FOREARM] / _FOREARM_RAD) ** 2).sum(-1)).mean()

    def of_shape(self, beta: Tensor) -> Tensor:
        """Return the cost of a shape [10]."""
        cost = _BETA_WEIGHT * ((beta - self.start.beta) ** 2).sum()
        return cost if self.length is None else cost + self.length.loss(beta)


def _slope(cost_of, at: Tensor) -> Tensor:
    at = at.clone().requires_grad_(True)
    return torch.autograd.grad(cost_of(at), at)[0].double()


class _Equations(NamedTuple):
    """Normal equations.

    Attributes:
        poses: [P, 54, 54].
        across: [P, 54, 10] of poses and the shape.
        telling: [P, 54, 10] of it what the shape follows.
        shape: [10, 10].
        of_poses, of_shape: [P, 54] and [10] gradients.
    """

    poses: Tensor
    across: Tensor
    telling: Tensor
    shape: Tensor
    of_poses: Tensor
    of_shape: Tensor


class _Fit:
    """The fit of all views.

    Args:
        views: of all pictures.
        priors: of poses and shape.
        fits_shape: move the shape, too.
    """

    def __init__(self, views: Sequence[_View], priors: _Priors, fits_shape: bool):
        self._views, self._priors, self._fits_shape = views, priors, fits_shape
        start = priors.start
        curve = torch.autograd.functional.hessian
        one = curve(lambda pose: priors.of_poses(pose.expand_as(start.poses)), start.poses[0])
        self._pose_curve = one.double() / len(start.poses)
        self._shape_curve = curve(priors.of_shape, start.beta).double()

    def solved(self, unknowns: Unknowns) -> Unknowns:
        """Step until the cost hardly falls; a step that raises it is taken back, and the next is shorter."""
        cost, damping, equations = self.cost(unknowns), _FIRST_DAMPING, self._equations(unknowns)
        for _ in range(_MOST_STEPS):
            new = self._stepped(unknowns, equations, damping)
            new_cost = self.cost(new)
            if not new_cost < cost:
                damping *= 10
                continue
            gain, unknowns, cost, damping = (cost - new_cost) / cost, new, new_cost, damping / 5
            if gain < _LEAST_GAIN:
                break
            equations = self._equations(unknowns)
        return unknowns

    def cost(self, unknowns: Unknowns) -> float:
        """Return what is minimised."""
        of_priors = self._priors.of_poses(unknowns.poses) + self._priors.of_shape(unknowns.beta)
        return float(of_priors) + sum(view.cost(unknowns) for view in self._views)

    def _equations(self, unknowns: Unknowns) -> _Equations:
        count = len(unknowns.poses)
        found = _Equations(
            self._pose_curve.repeat(count, 1, 1),
            torch.zeros(count, _POSE, 10, dtype=torch.float64),
            torch.zeros(count, _POSE, 10, dtype=torch.float64),
            self._shape_curve.clone(),
            _slope(self._priors.of_poses, unknowns.poses),
            _slope(self._priors.of_shape, unknowns.beta),
        )
        for view in self._views:
            matrix, gradient = view.normal_equations(unknowns)
            found.poses[view.pose] += matrix[:_POSE, :_POSE]
            found.across[view.pose] += matrix[:_POSE, BETA]
            found.of_poses[view.pose] += gradient[:_POSE]
            if view.tells_shape:
                found.telling[view.pose] += matrix[:_POSE, BETA]
                found.shape.add_(matrix[BETA, BETA])
                found.of_shape.add_(gradient[BETA])
        return found

    def _stepped(self, unknowns: Unknowns, equations: _Equations, damping: float) -> Unknowns:
        diagonal = torch.diag_embed(equations.poses.diagonal(dim1=1, dim2=2))
        right = torch.cat([equations.across, equations.of_poses[..., None]], -1)
        solved = torch.linalg.solve(equations.poses + damping * diagonal, right)
        across, alone = solved[..., :10], solved[..., 10]
        beta = torch.zeros_like(equations.of_shape)
        if self._fits_shape:
            telling = equations.telling.transpose(1, 2)
            damped = equations.shape + damping * equations.shape.diagonal().diag()
            reduced = equations.of_shape - (telling @ alone[..., None]).sum(0)[:, 0]
            beta = -torch.linalg.solve(damped - (telling @ across).sum(0), reduced)
        poses = -alone - across @ beta
        return Unknowns(unknowns.poses + poses.float(), unknowns.beta + beta.float())


def _views(
    hand: HandModel,
    pictures: Sequence[HandPicture],
    targets: Sequence[PoseTargets],
    offsets_m: Sequence[np.ndarray],
    pose_of: Sequence[int],
) -> list[_View]:
    """Weigh all pictures alike, and all outlines' vertices."""
    skin = SkinTensors.of(hand.for_side("right"))
    edges = max(sum(len(one.outline.vertex) for one in targets), 1)
    views = []
    for picture, target, offset_m, pose in zip(pictures, targets, offsets_m, pose_of, strict=True):
        outline = target.outline
        vertices = np.union1d(np.flatnonzero(target.weight), outline.vertex).astype(int)
        weight = target.weight[vertices] / max(target.weight.sum(), 1) / len(pictures)
        camera = picture.camera
        views.append(
            _View(
                VertexSubset.of(skin, torch.as_tensor(vertices)),
                _tensor(offset_m[vertices]),
                _tensor(np.linalg.inv(camera.cam2world)[:3]),
                _tensor(camera.K),
                _tensor(target.px[vertices]),
                _tensor(weight),
                _tensor(target.reliability[vertices]),
                torch.as_tensor(np.searchsorted(vertices, outline.vertex)),
                _tensor(outline.px),
                _tensor(outline.normal),
                _OUTLINE_WEIGHT / edges,
                pose,
                not picture.is_held_out,
            )
        )
    return views


def _tensor(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)


def _unknowns(pose: HandPose) -> Tensor:
    return _tensor(np.concatenate([np.ravel(pose.theta), pose.transl, pose.forearm]))


def _pose(values: Tensor, beta: np.ndarray) -> HandPose:
    theta, transl, forearm = (values[columns].numpy() for columns in (THETA, TRANSL, FOREARM))
    return HandPose(theta.reshape(16, 3), beta, transl, "right", forearm)


def _poses_of(pictures: Sequence[HandPicture]) -> tuple[list[int], list[int]]:
    """Return the first picture of each of P poses, and the pose of each picture."""
    first: dict[object, int] = {}
    for index, picture in enumerate(pictures):
        first.setdefault(("alone", index) if picture.moment is None else picture.moment, index)
    row = {index: place for place, index in enumerate(first.values())}
    shown = [row[index if picture.moment is None else first[picture.moment]] for index, picture in enumerate(pictures)]
    return list(first.values()), shown
