"""A hand in a pose, without gradients: as `hand.lbs.skin_motion` and `geometry.local_rotation.local_rotations`."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ...geometry.local_rotation import LocalFrames
from ...hand.lbs import SkinMotion, SkinTensors
from ...records.shot import HandPose
from ..reference import ReferenceBackend
from .kernels.compiled import launch
from .kernels.skinning import joint_motions, skin_vertices
from .kernels.skinning import local_rotations as fill_rotations

MOTION = 15
"""Numbers of a vertex's motion: its place at rest, and a transform [3, 4]."""


def skin_motion(skin: SkinTensors, pose: HandPose) -> SkinMotion:
    """Compute how a pose moves the vertices into the world, as `hand.lbs.skin_motion`."""
    template = skin.v_template
    theta, beta, transl, forearm = (
        template.new_tensor(values) for values in (pose.theta, pose.beta, pose.transl, pose.forearm)
    )
    joints, vertices = len(skin.parents), len(template)
    rest_joints = skin.J_regressor @ (template + skin.shapedirs @ beta)
    features, transforms = template.new_empty(9 * (joints - 1)), template.new_empty(joints + 1, 12)
    parents = torch.tensor(skin.parents, dtype=torch.int32, device=template.device)
    launch(joint_motions, joints + 1, theta, forearm[None], rest_joints, parents, features, transforms)
    values = template.new_empty(vertices, MOTION)
    of_vertices = template, skin.shapedirs, skin.posedirs, skin.lbs_weights, skin.arm_weights
    launch(skin_vertices, vertices, *of_vertices, beta, features, transforms, transl[None], values)
    return SkinMotion(values[:, :3], values[:, 3:].unflatten(1, (3, 4)))


def local_rotations(
    vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
) -> Float[Tensor, "V 3 3"]:
    """Compute matrices from the canonical template's directions to the world's, orthonormal (or mirrored)."""
    rotations = vertices.new_empty(len(vertices), 3, 3)
    launch(fill_rotations, len(vertices), vertices, normals, *frames, rotations)
    return rotations


class PoseStages(ReferenceBackend):
    """A hand in a pose by Warp."""

    skin_motion = staticmethod(skin_motion)
    local_rotations = staticmethod(local_rotations)
