"""A posed mesh on the CPU: as `hand.lbs.skin_motion`, `geometry.mesh.posed_mesh` and `local_rotations`, by kernels.

A mesh is small: one thread is faster than two.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...geometry.local_rotation import LocalFrames
from ...geometry.mesh import PosedMesh, Topology
from ...hand.lbs import SkinMotion, SkinTensors
from ...records.shot import HandPose
from ..kernels.posing import add_offsets, blend_transforms, joint_transforms, mesh_normals, rotate, surface_rotations
from .arrays import as_arrays


def skin_motion(skin: SkinTensors, pose: HandPose) -> SkinMotion:
    """How a pose moves the vertices into the world; `skin` is that of its side."""
    theta, beta, transl, forearm = (
        np.ascontiguousarray(values, np.float32) for values in (pose.theta, pose.beta, pose.transl, pose.forearm)
    )
    rest = skin.v_template.numpy().copy()
    _add(skin.shapedirs, beta, rest)
    rest_joints = (skin.J_regressor @ torch.as_tensor(rest)).numpy()
    rotations, transforms = np.empty((len(theta), 3, 3), np.float32), np.empty((len(theta), 3, 4), np.float32)
    for axis_angle, rotation in zip(theta, rotations, strict=True):
        rotate(axis_angle, rotation)
    joint_transforms(rotations, rest_joints, np.array(skin.parents), transforms)
    identity = np.eye(3, dtype=np.float32)
    _add(skin.posedirs, (rotations[1:] - identity).ravel(), rest)
    of_forearm = _of_forearm(forearm, transforms[0], rest_joints[0])
    blended, weights = np.empty((len(rest), 3, 4), np.float32), as_arrays(skin.lbs_weights, skin.arm_weights)
    blend_transforms(transforms, weights[0], of_forearm, weights[1], transl, blended)
    return SkinMotion(torch.as_tensor(rest), torch.as_tensor(blended))


def posed_mesh(topology: Topology, vertices: Float[Tensor, "V 3"]) -> PosedMesh:
    """Normals and scale of posed vertices."""
    normals = torch.empty_like(vertices, memory_format=torch.contiguous_format)
    length_m = mesh_normals(*as_arrays(vertices, topology.faces, topology.edges, normals))
    return PosedMesh(vertices, normals, length_m / topology.edge_length_m)


def local_rotations(
    vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
) -> Float[Tensor, "V 3 3"]:
    """Matrices from the canonical template's directions to the world's."""
    rotations = torch.empty(len(vertices), 3, 3)
    surface_rotations(*as_arrays(vertices, normals, *frames, rotations))
    return rotations


def _add(directions: Float[Tensor, "V 3 K"], features: np.ndarray, vertices: np.ndarray) -> None:
    """Add the features' sum of directions to vertices [V, 3]."""
    rows, values = directions.flatten(0, 1).numpy(), vertices.reshape(-1)
    if features.any():
        add_offsets(rows, features, values)


def _of_forearm(forearm: np.ndarray, wrist: np.ndarray, rest_wrist: np.ndarray) -> np.ndarray:
    """[3, 4] as `hand.lbs.forearm_offsets`, for a vertex that follows the forearm alone."""
    turned = np.empty((3, 3), np.float32)
    rotate(forearm, turned)
    by = turned - np.eye(3, dtype=np.float32)
    return wrist[:, :3] @ np.column_stack([by, -(by @ rest_wrist)])
