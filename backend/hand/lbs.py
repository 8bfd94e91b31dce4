"""Linear blend skinning with shape and pose correctives, batched and differentiable.

Romero et al. 2017, "Embodied Hands", equations 1-5 (SMPL's formulation). The root rotates about joint 0, then `transl`
is added. Vertices and joints in metres, in the template's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.torch_rotation import axis_angle_to_matrix
from ..records.shot import HandPose
from .model import HandModel


class SkinTensors(NamedTuple):
    """The arrays of a `HandModel` for skinning, on one device and in one dtype."""

    v_template: Tensor
    lbs_weights: Tensor
    J_regressor: Tensor
    shapedirs: Tensor
    posedirs: Tensor
    arm_weights: Tensor
    parents: tuple[int, ...]

    @classmethod
    def of(
        cls, model: HandModel, device: torch.device | str = "cpu", dtype: torch.dtype = torch.float32
    ) -> SkinTensors:
        """Convert the model's arrays to tensors."""
        names = ("v_template", "lbs_weights", "J_regressor", "shapedirs", "posedirs", "arm_weights")
        tensors = (torch.as_tensor(getattr(model, name), dtype=dtype, device=device) for name in names)
        return cls(*tensors, parents=tuple(int(parent) for parent in model.parents))


class PosedHand(NamedTuple):
    """Vertices [*b, V, 3] and joints [*b, 16, 3], posed, and each joint's rest-to-pose transform [*b, 16, 4, 4]."""

    vertices: Tensor
    joints: Tensor
    transforms: Tensor


class SkinMotion(NamedTuple):
    """How a pose moves the V vertices.

    Attributes:
        rest: [*b, V, 3] m, with shape and correctives, unposed.
        transforms: [*b, V, 3, 4] from there to the pose, each vertex's own.
    """

    rest: Tensor
    transforms: Tensor

    @property
    def vertices(self) -> Float[Tensor, "*b V 3"]:
        """Posed, m."""
        return (self.transforms[..., :3] @ self.rest[..., None])[..., 0] + self.transforms[..., 3]


def pose_hand(
    skin: SkinTensors,
    theta: Float[Tensor, "*b 16 3"],
    beta: Float[Tensor, "*b 10"],
    transl: Float[Tensor, "*b 3"],
    forearm: Float[Tensor, "*b 3"] | None = None,
) -> PosedHand:
    """Pose the hand; theta is the full absolute axis-angle pose, rad, and forearm as in `HandPose`; None: zeros."""
    return _posed(skin, theta, beta, transl, forearm)[1]


def skin_motion(skin: SkinTensors, pose: HandPose) -> SkinMotion:
    """Compute how a pose moves the vertices into the world; `skin` is that of its side."""
    like, values = skin.v_template, (pose.theta, pose.beta, pose.transl, pose.forearm)
    return _posed(skin, *(torch.as_tensor(value, dtype=like.dtype, device=like.device) for value in values))[0]


def _posed(
    skin: SkinTensors,
    theta: Float[Tensor, "*b 16 3"],
    beta: Float[Tensor, "*b 10"],
    transl: Float[Tensor, "*b 3"],
    forearm: Float[Tensor, "*b 3"] | None,
) -> tuple[SkinMotion, PosedHand]:
    rotations = axis_angle_to_matrix(theta)
    v_shaped = skin.v_template + _offsets(skin.shapedirs, beta)
    rest_joints = skin.J_regressor @ v_shaped
    transforms = joint_transforms(rotations, rest_joints, skin.parents)
    blended = (skin.lbs_weights @ transforms[..., :3, :].flatten(-2)).unflatten(-1, (3, 4))
    if forearm is not None:
        first, at = transforms[..., 0, :3, :], rest_joints[..., 0, :]
        blended = blended + forearm_offsets(skin.arm_weights, first, forearm, at)
    shift = torch.nn.functional.pad(transl[..., None, :, None], (3, 0))
    motion = SkinMotion(v_shaped + pose_correctives(skin, rotations), blended + shift)
    joints = (transforms[..., :3, :3] @ rest_joints[..., None])[..., 0] + transforms[..., :3, 3]
    return motion, PosedHand(motion.vertices, joints + transl[..., None, :], transforms)


def forearm_offsets(
    arm_weights: Float[Tensor, " V"],
    wrist: Float[Tensor, "*b 3 4"],
    forearm: Float[Tensor, "*b 3"],
    rest_wrist: Float[Tensor, "*b 3"],
) -> Float[Tensor, "*b V 3 4"]:
    """Compute what a forearm turned against the hand adds to the blended rest-to-pose transforms of vertices.

    Args:
        arm_weights: as in `HandModel`.
        wrist: rest-to-pose transform of joint 0.
        forearm: as in `HandPose`.
        rest_wrist: joint 0 of the shaped hand at rest.
    """
    turned = axis_angle_to_matrix(forearm)
    by = turned - torch.eye(3, dtype=turned.dtype, device=turned.device)
    about_wrist = torch.cat([by, -(by @ rest_wrist[..., None])], -1)
    return arm_weights[:, None, None] * (wrist[..., :3] @ about_wrist)[..., None, :, :]


def posed_vertices(model: HandModel, pose: HandPose) -> np.ndarray:
    """Pose the vertices [V, 3] m, world, float64; the pose may be of either side."""
    return posed_arrays(model, pose)[0]


def posed_arrays(model: HandModel, pose: HandPose) -> tuple[np.ndarray, np.ndarray]:
    """Find vertices [V, 3] and joints [16, 3], m, world, float64, of a pose of either side."""
    skin = SkinTensors.of(model.for_side(pose.side), dtype=torch.float64)
    values = (pose.theta, pose.beta, pose.transl, pose.forearm)
    posed = pose_hand(skin, *(torch.as_tensor(value, dtype=torch.float64) for value in values))
    return posed.vertices.numpy(), posed.joints.numpy()


def pose_correctives(skin: SkinTensors, rotations: Float[Tensor, "*b 16 3 3"]) -> Float[Tensor, "*b V 3"]:
    """Compute offsets of the template, linear in (R - I) of the 15 finger joints."""
    identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
    features = (rotations[..., 1:, :, :] - identity).flatten(-3)  # [*b, 135]
    return _offsets(skin.posedirs, features)


def _offsets(directions: Float[Tensor, "V 3 K"], features: Float[Tensor, "*b K"]) -> Float[Tensor, "*b V 3"]:
    """Sum the directions by their features, as one product of matrices."""
    return (features @ directions.flatten(0, 1).T).unflatten(-1, (len(directions), 3))


def joint_transforms(
    rotations: Float[Tensor, "*b 16 3 3"], rest_joints: Float[Tensor, "*b 16 3"], parents: tuple[int, ...]
) -> Float[Tensor, "*b 16 4 4"]:
    """Compute rest-to-pose transform of every joint, composed along the kinematic tree."""
    is_root = torch.tensor(parents, device=rest_joints.device)[:, None] < 0
    offsets = rest_joints - torch.where(is_root, 0, rest_joints[..., parents, :])
    of_joints, world = _rigid(rotations, offsets).unbind(-3), list[Tensor]()
    for local, parent in zip(of_joints, parents, strict=True):
        world.append(world[parent] @ local if parent >= 0 else local)
    stacked = torch.stack(world, -3)
    moved_rest = (stacked[..., :3, :3] @ rest_joints[..., None])[..., 0]
    return _rigid(stacked[..., :3, :3], stacked[..., :3, 3] - moved_rest)


def _rigid(rotation: Float[Tensor, "*b 3 3"], translation: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 4 4"]:
    top = torch.cat([rotation, translation[..., None]], -1)
    bottom = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=top.dtype, device=top.device).expand(*top.shape[:-2], 1, 4)
    return torch.cat([top, bottom], -2)
