"""Poses and shapes of another hand model in MANO's format as those of the built-in hand, which has an arm.

The built-in hand is laid over the other one at rest, once per file (`registration`). From then on every vertex has its
point on the other's surface, and a pose is fitted to where these points are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch

from ...geometry.mesh_tables import area_weighted_normals
from ...geometry.rotation import axis_angle_to_matrix
from ...hand.lbs import SkinTensors, posed_vertices
from ...hand.model import PARENTS, HandModel
from ...motion.spaces import rest_wrists
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ..natural_range import local_theta
from .point_fit import FitPrior, PointGoals, fitted_to_points
from .registration import Registration, registered, smoothed

_SHAPE_PRIOR = FitPrior(point_mm=1.0, theta_rad=0.05, beta=2.0)
_POSE_PRIOR = FitPrior(point_mm=1.0, theta_rad=0.1, beta=0.0)
_MOST_OFFSET_M = 0.004
_SHAPE_ROUNDS = 3  # of shape and offsets in turn


class TransferredHand(NamedTuple):
    """Poses of the built-in hand, of one shape.

    Attributes:
        poses: in the order of the other model's.
        offset_m: [V] what no beta gives of the other's shape, along the normals.
        deviation_mm: [P] root mean square distance of both surfaces' points in each pose.
    """

    poses: tuple[HandPose, ...]
    offset_m: np.ndarray
    deviation_mm: np.ndarray


@dataclass(frozen=True)
class ModelTransfer:
    """The built-in hand upon another hand model; both of one side.

    Attributes:
        ours: the built-in hand, or another with shapes.
        other: the other model.
        registration: of ours upon the other at rest.
    """

    ours: HandModel
    other: HandModel
    registration: Registration

    @classmethod
    def of(cls, ours: HandModel, other: HandModel) -> ModelTransfer:
        """Lay one over the other.

        Raises:
            LiveHandError: they are of different sides, or too unlike.
        """
        if ours.side != other.side:
            raise LiveHandError(f"both hands must be of one side, got {ours.side} and {other.side}; mirror one")
        return cls(ours, other, registered(ours, other))

    def transferred(self, poses: Sequence[HandPose]) -> TransferredHand:
        """Pose our hand as the other's surface is posed; the shape is that of the poses' median beta.

        Raises:
            LiveHandError: a pose is of the other side.
        """
        if any(pose.side != self.other.side for pose in poses):
            raise LiveHandError(f"poses must be of the model's side, {self.other.side}, got the other; mirror them")
        shape, offset_m = self.shape(np.median([pose.beta for pose in poses], 0))
        fits = [self._fitted(pose, shape, offset_m) for pose in poses]
        return TransferredHand(tuple(fit for fit, _ in fits), offset_m, np.array([off_mm for _, off_mm in fits]))

    def shape(self, beta: np.ndarray) -> tuple[HandPose, np.ndarray]:
        """Find our rest pose and shape, and offsets [V] m along normals, for a beta [10] of the other model."""
        rest = self.registration.rest
        goal = self.points(HandPose(np.zeros((16, 3)), beta, np.zeros(3), self.other.side))
        pose, offset_m = rest, np.zeros(len(self.ours.v_template))
        for _ in range(_SHAPE_ROUNDS):
            pose = self._fit(replace(rest, beta=pose.beta), goal, offset_m, _SHAPE_PRIOR)
            offset_m = self._offset(pose, goal)
        return pose, offset_m

    def points(self, pose: HandPose) -> np.ndarray:
        """Pose the other model, and return where its surface has each of our vertices [V, 3], m."""
        return self.registration.points.blended(posed_vertices(self.other, pose)[self.other.f])

    def _fitted(self, pose: HandPose, shape: HandPose, offset_m: np.ndarray) -> tuple[HandPose, float]:
        goal, has_point = self.points(pose), self.registration.weight > 0
        fit = self._fit(self._turned(pose, shape), goal, offset_m, _POSE_PRIOR)
        off = (self._surface(fit, offset_m) - goal)[has_point]
        return fit, 1000 * float(np.sqrt((off**2).sum(1).mean()))

    def _turned(self, pose: HandPose, shape: HandPose) -> HandPose:
        """Turn each of our joints in the world as the other's has turned since rest."""
        turned = _world_rotations(pose.theta) @ _world_rotations(shape.theta)
        wrist = rest_wrists(self.other, pose.beta)
        rest_wrist = rest_wrists(self.ours, shape.beta)
        between = axis_angle_to_matrix(pose.theta[0]) @ (rest_wrist + shape.transl - wrist)
        return replace(
            pose,
            theta=local_theta(turned[None])[0],
            beta=shape.beta,
            transl=wrist + pose.transl + between - rest_wrist,
            forearm=np.zeros(3),
        )

    def _fit(self, start: HandPose, goal: np.ndarray, offset_m: np.ndarray, prior: FitPrior) -> HandPose:
        """Fit to points, twice: the offsets turn with the pose."""
        vertex = np.flatnonzero(self.registration.weight)
        pose, skin = start, SkinTensors.of(self.ours, dtype=torch.float64)
        for _ in range(2):
            normals = self._normals(pose)[vertex]
            goals = PointGoals(
                vertex,
                goal[vertex],
                normals,
                self.registration.weight[vertex],
                offset_m=offset_m[vertex, None] * normals,
            )
            pose = fitted_to_points(skin, pose, goals, prior, steps=4)
        return pose

    def _offset(self, pose: HandPose, goal: np.ndarray) -> np.ndarray:
        """Measure how far the other's surface is along our normals [V], m; it dies out where there is none."""
        off = ((goal - posed_vertices(self.ours, pose)) * self._normals(pose)).sum(1)
        return smoothed(self.ours, off, self.registration.weight).clip(-_MOST_OFFSET_M, _MOST_OFFSET_M)

    def _normals(self, pose: HandPose) -> np.ndarray:
        return area_weighted_normals(posed_vertices(self.ours, pose), self.ours.f)

    def _surface(self, pose: HandPose, offset_m: np.ndarray) -> np.ndarray:
        vertices = posed_vertices(self.ours, pose)
        return vertices + offset_m[:, None] * area_weighted_normals(vertices, self.ours.f)


def _world_rotations(theta: np.ndarray) -> np.ndarray:
    """Compute the joints' rotations [16, 3, 3] since rest, in the world."""
    world: list[np.ndarray] = []
    for local, above in zip(axis_angle_to_matrix(theta), PARENTS, strict=True):
        world.append(local if above < 0 else world[above] @ local)
    return np.stack(world)
