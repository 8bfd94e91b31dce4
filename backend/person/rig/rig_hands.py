"""One or two hands of one person as tensors with gradients: one shape, a pose each, and offsets of the skin.

Hands of both sides are posed as right hands at once; a left one is mirrored, as its parameters are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...geometry.mesh_tables import area_weighted_normals
from ...hand.lbs import PosedHand, SkinTensors, forearm_offsets, pose_hand
from ...hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT, HandModel
from ...motion.landmarks.skeleton import NODES_OF_LANDMARKS, tip_vertices
from ...records.shot import HandPose
from ...records.side import Side

_ARM = 0.5  # weight from which a vertex is forearm


class HandParameters(NamedTuple):
    """Of S hands, as `HandPose` has them: theta [S, 16, 3], the one beta [10], transl [S, 3], forearm [S, 3]."""

    theta: Tensor
    beta: Tensor
    transl: Tensor
    forearm: Tensor


class ShownHands(NamedTuple):
    """Vertices [S, V, 3] and landmarks [S, 21, 3] in MediaPipe's order, m, world."""

    vertices: Tensor
    landmarks: Tensor

    @property
    def all_vertices(self) -> Tensor:
        """[S * V, 3], as `RigHands.faces` counts them."""
        return self.vertices.flatten(0, 1)


@dataclass(frozen=True)
class RigHands:
    """The hand model of both sides.

    Attributes:
        sides: of the S hands.
        skin: of the right hand.
        faces: [S * F, 3] of all hands, wound outward.
        arm: [V] bool, which vertices are forearm.
        arm_faces: [S * F] bool, which faces have a vertex of the forearm.
        normals: [V, 3] of the right template at rest.
        tips: [5] vertices.
        mirror: [S, 3] what points of the right hand are multiplied by.
    """

    sides: tuple[Side, ...]
    skin: SkinTensors
    faces: Tensor
    arm: Tensor
    arm_faces: Tensor
    normals: Tensor
    tips: Tensor
    mirror: Tensor

    @classmethod
    def of(cls, model: HandModel, sides: Sequence[Side]) -> RigHands:
        """Prepare a hand model, whatever side its file is of."""
        right = model.for_side("right")
        faces = [model.for_side(side).f + row * len(right.v_template) for row, side in enumerate(sides)]
        all_faces = np.concatenate(faces).astype(np.int64)
        arm = right.arm_weights > _ARM
        normals = area_weighted_normals(right.v_template, right.f)
        mirror = np.stack([MIRROR_POINT if side == "left" else np.ones(3) for side in sides])
        return cls(
            sides=tuple(sides),
            skin=SkinTensors.of(right),
            faces=torch.as_tensor(all_faces),
            arm=torch.as_tensor(arm),
            arm_faces=torch.as_tensor(arm[all_faces % len(arm)].any(1)),
            normals=torch.as_tensor(normals / np.linalg.norm(normals, axis=1, keepdims=True), dtype=torch.float32),
            tips=torch.as_tensor(tip_vertices(right)),
            mirror=torch.as_tensor(mirror, dtype=torch.float32),
        )

    def of_landmarks_alone(self) -> RigHands:
        """Leave only the vertices that landmarks need: 5 tips, and one in each of the 16 joints at rest."""
        skin, tips, count = self.skin, self.tips, len(self.skin.parents)
        at_joints = torch.einsum("jv,vck->jck", skin.J_regressor, skin.shapedirs)
        alone = SkinTensors(
            v_template=torch.cat([skin.v_template[tips], skin.J_regressor @ skin.v_template]),
            lbs_weights=torch.cat([skin.lbs_weights[tips], torch.eye(count)]),
            J_regressor=torch.cat([torch.zeros(count, len(tips)), torch.eye(count)], 1),
            shapedirs=torch.cat([skin.shapedirs[tips], at_joints]),
            posedirs=torch.cat([skin.posedirs[tips], torch.zeros(count, *skin.posedirs.shape[1:])]),
            arm_weights=torch.cat([skin.arm_weights[tips], torch.zeros(count)]),
            parents=skin.parents,
        )
        return replace(self, skin=alone, tips=torch.arange(len(tips)))

    def parameters(self, poses: Mapping[Side, HandPose]) -> HandParameters:
        """Stack poses; the shape is the mean of theirs."""
        own = [poses[side] for side in self.sides]
        arrays = (
            [p.theta for p in own],
            np.mean([p.beta for p in own], 0),
            [p.transl for p in own],
            [p.forearm for p in own],
        )
        return HandParameters(*(torch.as_tensor(np.array(array), dtype=torch.float32) for array in arrays))

    def poses(self, parameters: HandParameters) -> dict[Side, HandPose]:
        """Convert parameters to records."""
        theta, beta, transl, forearm = (values.detach().double().numpy() for values in parameters)
        return {side: HandPose(theta[s], beta, transl[s], side, forearm[s]) for s, side in enumerate(self.sides)}

    def show(self, parameters: HandParameters, offset: Float[Tensor, "S V 3"] | None = None) -> ShownHands:
        """Pose the hands; `offset` is added to the vertices, m, world."""
        posed = self._posed_right(parameters)
        nodes = [posed.joints[:, :1]]
        for finger in range(5):
            tip = posed.vertices[:, self.tips[finger]][:, None]
            nodes += [posed.joints[:, 3 * finger + 1 : 3 * finger + 4], tip]
        landmarks = torch.cat(nodes, 1)[:, list(NODES_OF_LANDMARKS)]
        vertices = posed.vertices * self.mirror[:, None]
        return ShownHands(vertices if offset is None else vertices + offset, landmarks * self.mirror[:, None])

    def posed_normals(self, parameters: HandParameters) -> Float[Tensor, "S V 3"]:
        """Turn the template's normals at rest as the skin turns, without gradients: the directions of offsets."""
        with torch.no_grad():
            posed, right = self._posed_right(parameters), self._right(parameters)
            turn = (self.skin.lbs_weights @ posed.transforms[..., :3, :].flatten(-2)).unflatten(-1, (3, 4))
            first, at_wrist = posed.transforms[:, 0, :3, :], torch.zeros_like(right.transl)  # only rotations are used
            turn = turn + forearm_offsets(self.skin.arm_weights, first, right.forearm, at_wrist)
            normals = (turn[..., :3] @ self.normals[:, :, None])[..., 0]
            return torch.nn.functional.normalize(normals, dim=-1) * self.mirror[:, None]

    def _right(self, parameters: HandParameters) -> HandParameters:
        axis = torch.where(self.mirror[:, :1] < 0, torch.as_tensor(MIRROR_AXIS_ANGLE, dtype=torch.float32), 1.0)
        theta, beta, transl, forearm = parameters
        return HandParameters(theta * axis[:, None], beta, transl * self.mirror, forearm * axis)

    def _posed_right(self, parameters: HandParameters) -> PosedHand:
        theta, beta, transl, forearm = self._right(parameters)
        return pose_hand(self.skin, theta, beta.expand(len(theta), 10), transl, forearm)
