"""Pose correctives in closed form: a bulge at each bent joint that restores the volume lost by linear blend skinning.

A joint bent by the angle t about the axis a bulges by (1 - cos t) times a displacement field. That is linear in R - I:
with K the cross matrix of a, R - I = sin t K + (1 - cos t) K^2 and <K, K^2> = 0, <K^2, K^2> = 2, so
1 - cos t = <R - I, K^2 / 2>. Hence `posedirs` represents it exactly. Build frame, mm.
"""

from __future__ import annotations

import numpy as np
import torch
import trimesh

from ...backend.geometry.torch_rotation import axis_angle_to_matrix
from ...backend.hand.lbs import joint_transforms
from ...backend.hand.model import PARENTS
from ...backend.teacher.anatomy import DIGITS
from ...backend.teacher.smooth import smoothstep
from .joint_frames import JointFrames

_LARGEST_BULGE, _LARGEST_MCP_BULGE = 2.6, 3.0  # mm at 90 degrees


def pose_correctives(
    vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, normals: np.ndarray, frames: JointFrames
) -> np.ndarray:
    """Compute [V, 3, 135] mm per unit of (R - I) of joints 1..15. The thumb's first joint, in the palm, has none."""
    posedirs = np.zeros((len(vertices), 3, 135))
    for joint in range(1, 16):
        if joint == 1 + 3 * DIGITS.index("thumb"):
            continue
        bulge = normals * _profile(joint, vertices, weights, frames)[:, None]
        height = _height(joint, bulge, vertices, faces, weights, frames)
        cross = np.cross(np.eye(3), frames.flexion[joint]).T  # K with K @ x = axis x x, up to its sign, which K^2 loses
        posedirs[:, :, 9 * (joint - 1) : 9 * joint] = height * bulge[:, :, None] * (cross @ cross / 2).ravel()
    return posedirs


def _profile(joint: int, vertices: np.ndarray, weights: np.ndarray, frames: JointFrames) -> np.ndarray:
    """Return [V] shape of the bulge, in [0, 1]: where weights blend, stronger on the back than on the palm."""
    order = (joint - 1) % 3
    is_mcp = _is_mcp(joint)
    offsets = vertices - frames.position[joint]
    along, dorsal = offsets @ frames.bone[joint], offsets @ frames.dorsal[joint]
    radius = np.maximum(np.linalg.norm(offsets - np.outer(along, frames.bone[joint]), axis=1), 1)
    beyond = weights[:, joint : joint + 3 - order].sum(1)
    between_two = np.minimum(weights[:, [joint, PARENTS[joint]]].sum(1), 1)
    zone = 4 * beyond * (1 - beyond) * between_two**4 * np.exp(-((along / (13 if order == 0 else 9)) ** 2))
    on_back, on_palm = smoothstep(dorsal / radius, -0.2, 0.7), smoothstep(-dorsal / radius, 0.2, 0.9)
    if is_mcp:
        return zone * (0.35 + 0.65 * on_back) * (1 - 0.3 * on_palm)
    return zone * (0.55 + 0.45 * on_back) * (1 - 0.45 * on_palm)


def _height(
    joint: int, bulge: np.ndarray, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, frames: JointFrames
) -> float:
    """Compute the factor of the bulge that restores the volume lost at 90 degrees, up to the largest allowed."""
    lost = _volume(vertices, faces) - _volume(_bent(joint, vertices, weights, frames), faces)
    gained = _volume(_bent(joint, vertices + bulge, weights, frames), faces)
    gained -= _volume(_bent(joint, vertices, weights, frames), faces)
    return float(np.clip(lost / max(gained, 1e-6), 0, _LARGEST_MCP_BULGE if _is_mcp(joint) else _LARGEST_BULGE))


def _is_mcp(joint: int) -> bool:
    return (joint - 1) % 3 == 0 and joint < 1 + 3 * DIGITS.index("thumb")


def _bent(joint: int, vertices: np.ndarray, weights: np.ndarray, frames: JointFrames) -> np.ndarray:
    """Skin vertices [V, 3] with one joint flexed by 90 degrees."""
    theta = np.zeros((16, 3))
    theta[joint] = np.pi / 2 * frames.flexion[joint]
    transforms = joint_transforms(
        axis_angle_to_matrix(torch.as_tensor(theta)), torch.as_tensor(frames.position), PARENTS
    ).numpy()
    blended = np.einsum("vj,jab->vab", weights, transforms[:, :3])
    return np.einsum("vab,vb->va", blended[:, :, :3], vertices) + blended[:, :, 3]


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Measure the enclosed volume, ml."""
    return float(trimesh.Trimesh(vertices, faces, process=False).volume) / 1000
