"""The ten shape directions: the offsets of the template and its joints per unit of beta. Build frame, mm.

They are designed by hand, not learnt. A unit is a few per cent, about the variation between people. All but the last
scale each bone in its own frame and concatenate the scaled bones along the kinematic tree.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...backend.hand.model import PARENTS
from ...backend.teacher.frames import swap_distal
from ...backend.teacher.smooth import bump
from .joint_frames import JointFrames

NAMES = (
    "size", "girth", "finger length", "palm breadth", "depth", "thumb length", "little finger length",
    "2D:4D", "taper", "eminences",
)  # fmt: skip

_ALL = tuple(range(1, 16))
_THUMB, _INDEX, _RING, _PINKY = (13, 14, 15), (1, 2, 3), (10, 11, 12), (7, 8, 9)
_LAST, _FIRST_OF_FINGERS = (3, 6, 9, 12, 15), (1, 4, 7, 10)

Factors = dict[tuple[int, ...], float]


@dataclass(frozen=True)
class BoneScaling:
    """The scaling of the bones by one direction; groups that are not named keep their size.

    Attributes:
        along: factor of the length, per group of joints.
        lateral: factor of the breadth.
        depth: factor of the depth.
        palm: factors of the palm and forearm in x, y, z of the build frame.
    """

    along: Factors = field(default_factory=dict)
    lateral: Factors = field(default_factory=dict)
    depth: Factors = field(default_factory=dict)
    palm: tuple[float, float, float] = (1.0, 1.0, 1.0)


SCALINGS = (
    BoneScaling({_ALL: 1.045}, {_ALL: 1.045}, {_ALL: 1.045}, palm=(1.045, 1.045, 1.045)),
    BoneScaling(lateral={_ALL: 1.05}, depth={_ALL: 1.05}, palm=(1.0, 1.05, 1.035)),
    BoneScaling(along={_ALL: 1.04}, palm=(0.98, 1.0, 1.0)),
    BoneScaling(palm=(1.0, 1.0, 1.045)),
    BoneScaling(depth={_ALL: 1.05}, palm=(1.0, 1.06, 1.0)),
    BoneScaling(along={_THUMB: 1.05}),
    BoneScaling(along={_PINKY: 1.06}),
    BoneScaling(along={_INDEX: 1.025, _RING: 0.975}),
    BoneScaling(lateral={_LAST: 1.06, _FIRST_OF_FINGERS: 0.97}, depth={_LAST: 1.06, _FIRST_OF_FINGERS: 0.97}),
)

# The thenar and the hypothenar eminence: centre and radii (anatomical frame, mm), height of the bulge (mm).
_EMINENCES = (
    (np.array([34, -26, 27]), np.array([26, 14, 16]), 1.8),
    (np.array([42, -18, -28]), np.array([32, 14, 14]), 1.44),
)


class ShapeDirections(NamedTuple):
    """Offsets per unit of beta of the vertices [V, 3, 10] and of the joints [16, 3, 10]."""

    vertices: np.ndarray
    joints: np.ndarray


def shape_directions(
    vertices: np.ndarray, normals: np.ndarray, weights: np.ndarray, frames: JointFrames
) -> ShapeDirections:
    """Build the ten directions of a hand with vertices [V, 3], unit normals [V, 3] and skinning weights [V, 16]."""
    moved = [_scaled(vertices, weights, frames, scaling) for scaling in SCALINGS]
    of_vertices = [offset for offset, _ in moved] + [_eminences(vertices, normals)]
    of_joints = [offset for _, offset in moved] + [np.zeros((16, 3))]
    return ShapeDirections(np.stack(of_vertices, -1), np.stack(of_joints, -1))


def _scaled(
    vertices: np.ndarray, weights: np.ndarray, frames: JointFrames, scaling: BoneScaling
) -> tuple[np.ndarray, np.ndarray]:
    """Compute offsets of vertices [V, 3] and joints [16, 3]."""
    matrices = _bone_matrices(frames, scaling)
    rest, joints = frames.position, np.zeros((16, 3))
    for joint, parent in enumerate(PARENTS):
        joints[joint] = joints[parent] + matrices[parent] @ (rest[joint] - rest[parent]) if parent >= 0 else rest[0]
    carried = joints + np.einsum("jab,vjb->vja", matrices, vertices[:, None] - rest)
    return np.einsum("vj,vja->va", weights, carried) - vertices, joints - rest


def _bone_matrices(frames: JointFrames, scaling: BoneScaling) -> np.ndarray:
    """Compute [16, 3, 3] scale of each bone along its own axes, and of the palm along the frame's axes."""
    directions = (frames.bone, frames.lateral, frames.dorsal)
    factors = (_per_joint(part) for part in (scaling.along, scaling.lateral, scaling.depth))
    matrices = sum(
        factor[:, None, None] * direction[:, :, None] * direction[:, None, :]
        for factor, direction in zip(factors, directions, strict=True)
    )
    matrices = np.asarray(matrices)
    matrices[0] = np.diag(scaling.palm)
    return matrices


def _per_joint(factors: Factors) -> np.ndarray:
    values = np.ones(16)
    for joints, factor in factors.items():
        values[list(joints)] = factor
    return values


def _eminences(vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    points = swap_distal(vertices)
    height = sum(
        bump(np.linalg.norm((points - centre) / radii, axis=1), 0.8) * size for centre, radii, size in _EMINENCES
    )
    return normals * np.asarray(height)[:, None]
