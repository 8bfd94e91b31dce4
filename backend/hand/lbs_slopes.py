"""How vertices of a posed hand move with its pose and shape: the derivatives of `lbs.pose_hand`, in closed form.

A turn of a joint moves what hangs on it about the joint; a turn of a finger also changes the pose correctives. For
given rotations, vertices are linear in shape. Automatic differentiation takes a pass for each of the parameters.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.torch_rotation import axis_angle_to_matrix, cross_matrix
from .lbs import SkinTensors, forearm_offsets, joint_transforms

THETA, TRANSL, FOREARM, BETA = slice(0, 48), slice(48, 51), slice(51, 54), slice(54, 64)
"""The columns of slopes."""
UNKNOWNS = 64
_SMALL_ANGLE_SQUARED = 1e-6  # rad^2, as in `torch_rotation`


class VertexSlopes(NamedTuple):
    """Posed vertices [N, 3], m, and their slopes [N, 3, 64]: m per rad, m, rad and unit of beta."""

    vertices: Tensor
    slopes: Tensor


class VertexSubset(NamedTuple):
    """Some of a hand's vertices, as in `SkinTensors`, and its joints at rest [16, 3], m, with their slopes [16, 3, 10].

    Attributes:
        hangs: [16, 16] whether the joint of a column is that of a row, or hangs on it.
    """

    v_template: Tensor
    lbs_weights: Tensor
    shapedirs: Tensor
    posedirs: Tensor
    arm_weights: Tensor
    joints: Tensor
    joint_slopes: Tensor
    hangs: Tensor
    parents: tuple[int, ...]

    @classmethod
    def of(cls, skin: SkinTensors, vertices: Tensor) -> VertexSubset:
        """Take the vertices [N]."""
        names = ("v_template", "lbs_weights", "shapedirs", "posedirs", "arm_weights")
        joints = skin.J_regressor @ skin.v_template
        joint_slopes = torch.einsum("jv,vck->jck", skin.J_regressor, skin.shapedirs)
        hangs = torch.eye(len(skin.parents), dtype=joints.dtype)
        for joint, parent in enumerate(skin.parents):
            if parent >= 0:
                hangs[:, joint] += hangs[:, parent]
        of_vertices = {name: getattr(skin, name)[vertices] for name in names}
        return cls(**of_vertices, joints=joints, joint_slopes=joint_slopes, hangs=hangs, parents=skin.parents)


def vertex_slopes(
    part: VertexSubset,
    theta: Float[Tensor, "16 3"],
    beta: Float[Tensor, " 10"],
    transl: Float[Tensor, " 3"],
    forearm: Float[Tensor, " 3"],
) -> VertexSlopes:
    """Pose vertices as `pose_hand` does, and say how each moves by each parameter."""
    posed = _PosedPart.of(part, theta, beta, forearm)
    slopes = posed.rest.new_zeros((*posed.rest.shape, UNKNOWNS))
    by_joint = slopes[..., THETA].unflatten(-1, (16, 3))
    _add_turns(by_joint, part, theta, posed)
    by_joint[:, :, 1:] += _of_correctives(part, theta, posed).unflatten(-1, (15, 3))
    slopes[..., TRANSL] = torch.eye(3, dtype=slopes.dtype)
    slopes[..., FOREARM] = _of_forearm(part, forearm, posed)
    slopes[..., BETA] = _of_shape(part, posed)
    return VertexSlopes(posed.vertices + transl, slopes)


def posed_part(
    part: VertexSubset,
    theta: Float[Tensor, "16 3"],
    beta: Float[Tensor, " 10"],
    transl: Float[Tensor, " 3"],
    forearm: Float[Tensor, " 3"],
) -> Float[Tensor, "N 3"]:
    """Pose vertices as `pose_hand` does."""
    return _PosedPart.of(part, theta, beta, forearm).vertices + transl


def turn_slopes(axis_angle: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Compute by which turns, rad, in columns, a rotation changes with its axis-angle: the left Jacobian of SO(3)."""
    squared = (axis_angle * axis_angle).sum(-1)[..., None, None]
    is_small = squared < _SMALL_ANGLE_SQUARED
    safe = torch.where(is_small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    first = torch.where(is_small, 0.5 - squared / 24, (1 - angle.cos()) / safe)
    second = torch.where(is_small, 1 / 6 - squared / 120, (angle - angle.sin()) / (safe * angle))
    cross = cross_matrix(axis_angle)
    return torch.eye(3, dtype=cross.dtype) + first * cross + second * (cross @ cross)


class _PosedPart(NamedTuple):
    """A posed hand in parts; its root is where the rest pose has it, before `transl`.

    Attributes:
        rotations: [16, 3, 3] local.
        turned: [16, 3, 3] of each joint in the world.
        shifts: [16, 3] of the transforms from rest to pose.
        rest_joints, joints: [16, 3].
        rest: [N, 3] with shape and correctives.
        blended: [N, 3, 4] each vertex's transform.
        vertices: [N, 3].
    """

    rotations: Tensor
    turned: Tensor
    shifts: Tensor
    rest_joints: Tensor
    joints: Tensor
    rest: Tensor
    blended: Tensor
    vertices: Tensor

    @classmethod
    def of(cls, part: VertexSubset, theta: Tensor, beta: Tensor, forearm: Tensor) -> _PosedPart:
        rotations = axis_angle_to_matrix(theta)
        rest_joints = part.joints + part.joint_slopes @ beta
        transforms = joint_transforms(rotations, rest_joints, part.parents)[:, :3]
        turned, shifts = transforms[..., :3], transforms[..., 3]
        joints = (turned @ rest_joints[..., None])[..., 0] + shifts
        blended = (part.lbs_weights @ transforms.flatten(1)).unflatten(-1, (3, 4))
        blended = blended + forearm_offsets(part.arm_weights, transforms[0], forearm, rest_joints[0])
        bent = (rotations[1:] - torch.eye(3, dtype=theta.dtype)).flatten()
        rest = part.v_template + part.shapedirs @ beta + part.posedirs @ bent
        vertices = (blended[..., :3] @ rest[..., None])[..., 0] + blended[..., 3]
        return cls(rotations, turned, shifts, rest_joints, joints, rest, blended, vertices)


def _add_turns(slopes: Tensor, part: VertexSubset, theta: Tensor, posed: _PosedPart) -> None:
    """Add what joints that turn move to slopes [N, 3, 16, 3]: the turns' axes times the arms from the joints."""
    by_joint = posed.rest @ posed.turned.transpose(1, 2) + posed.shifts[:, None]  # [16, N, 3]
    weights = part.lbs_weights.T
    arms = (part.hangs @ (weights[..., None] * by_joint).flatten(1)).unflatten(-1, (-1, 3))
    arms = arms - (part.hangs @ weights)[..., None] * posed.joints[:, None]
    arms[0] = posed.vertices - posed.joints[0]  # what the forearm's turn adds hangs on the root, too
    above = torch.stack([posed.turned[parent] if parent >= 0 else torch.eye(3) for parent in part.parents])
    axes = above.to(theta) @ turn_slopes(theta)  # [16, 3, 3] in columns
    arms = arms.movedim(0, 1)[..., None]  # [N, 16, 3, 1]
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        slopes[:, x] += axes[:, y] * arms[:, :, z] - axes[:, z] * arms[:, :, y]


def _of_correctives(part: VertexSubset, theta: Tensor, posed: _PosedPart) -> Tensor:
    """Return the slopes [N, 3, 45] of the correctives, which the fingers' joints change."""
    changes = cross_matrix(turn_slopes(theta[1:]).transpose(1, 2)) @ posed.rotations[1:, None]  # [15, 3, 3, 3]
    moved = part.posedirs @ torch.block_diag(*changes.flatten(2).transpose(1, 2))
    return posed.blended[..., :3] @ moved


def _of_forearm(part: VertexSubset, forearm: Tensor, posed: _PosedPart) -> Tensor:
    """Return the slopes [N, 3, 3] of an arm that turns about the wrist."""
    changes = cross_matrix(turn_slopes(forearm).T) @ axis_angle_to_matrix(forearm)
    arms = part.arm_weights[:, None] * (posed.rest - posed.rest_joints[0])
    return torch.einsum("idc,nc->ndi", posed.turned[0] @ changes, arms)


def _of_shape(part: VertexSubset, posed: _PosedPart) -> Tensor:
    """Return the slopes [N, 3, 10] of shape, linear for given rotations."""
    of_joints, moved = part.joint_slopes, list[Tensor]()
    for joint, parent in enumerate(part.parents):
        above = moved[parent] + posed.turned[parent] @ (of_joints[joint] - of_joints[parent]) if parent >= 0 else None
        moved.append(of_joints[joint] if above is None else above)
    shifts = torch.stack(moved) - posed.turned @ of_joints
    of_bone = (part.lbs_weights @ posed.turned.flatten(1)).unflatten(-1, (3, 3))
    of_arm = posed.blended[..., :3] - of_bone  # what the forearm's turn adds
    shift = (part.lbs_weights @ shifts.flatten(1)).unflatten(-1, (3, 10)) - of_arm @ of_joints[0]
    return posed.blended[..., :3] @ part.shapedirs + shift
