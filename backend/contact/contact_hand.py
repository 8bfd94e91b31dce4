"""A hand's skin as points that may touch things, posed many times quickly, in the frame of its unturned wrist.

Points are the vertices of the hand without its arm, the middles of their edges and the centres of their faces. Digits
are in MANO's order: index, middle, little, ring, thumb; 5 is the palm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ..geometry.mesh_tables import area_weighted_normals, half_edges
from ..geometry.rotation import axis_angle_to_matrix
from ..hand.gestures import FingerAxes
from ..hand.joint_axes import finger_axes
from ..hand.joint_limits import usual_limits_deg
from ..hand.lbs import SkinTensors, joint_transforms, pose_correctives
from ..hand.model import HandModel

PALM = 5
_PALMAR_COSINE = -0.35  # of a point's normal with the way to the palm: tips and sides touch things, backs do not


@dataclass(frozen=True, eq=False)
class ContactHand:
    """A right hand of a shape.

    Attributes:
        axes: of its joints' angles.
        limits_rad: [15, 2, 3] usual smallest and largest flexion, abduction and twist.
        vertices: [N] which of the model's vertices belong to the hand.
        faces: [F, 3] into these.
        corners: [P, 3] of these vertices, between which a point lies.
        shares: [P, 3] of the corners in it.
        joint: [P] that a point follows most.
        is_palmar: [P] whether it does not belong to the back of its bone.
        rest: [P, 3] m, the points at rest.
        rest_joints: [16, 3] m.
    """

    axes: FingerAxes
    limits_rad: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    corners: np.ndarray
    shares: np.ndarray
    joint: np.ndarray
    is_palmar: np.ndarray
    rest: np.ndarray
    rest_joints: np.ndarray
    _skin: SkinTensors
    _template: Tensor
    _joints: Tensor

    @classmethod
    def of(cls, model: HandModel, beta: np.ndarray) -> ContactHand:
        """Prepare a model, of either side, in the shape beta [10]."""
        right = model.for_side("right")
        shape = right.v_template + right.shapedirs @ beta
        vertices = np.flatnonzero(right.arm_weights == 0)
        faces = _faces_of(right.f, vertices)
        corners, shares = _points(faces, len(vertices))
        weights = (right.lbs_weights[vertices][corners] * shares[..., None]).sum(1)
        joint = weights.argmax(1)
        axes = finger_axes(right)
        rest = (shape[vertices][corners] * shares[..., None]).sum(1)
        normals = area_weighted_normals(shape[vertices], faces)
        normals = (normals[corners] * shares[..., None]).sum(1)
        towards_palm = np.where(joint[:, None] > 0, -axes.dorsal[joint], -axes.dorsal[1:13:3].mean(0))
        is_palmar = (normals * towards_palm).sum(1) > _PALMAR_COSINE
        skin, joints = _subset(right, vertices), right.J_regressor @ shape
        return cls(
            axes=axes,
            limits_rad=np.deg2rad(usual_limits_deg(right)),
            vertices=vertices,
            faces=faces,
            corners=corners,
            shares=shares,
            joint=joint,
            is_palmar=is_palmar,
            rest=rest,
            rest_joints=joints,
            _skin=skin,
            _template=torch.as_tensor(shape[vertices], dtype=torch.float32),
            _joints=torch.as_tensor(joints, dtype=torch.float32),
        )

    @cached_property
    def digit(self) -> np.ndarray:
        """[P] digit of each point."""
        return np.where(self.joint == 0, PALM, (self.joint - 1) // 3)

    @cached_property
    def lengths_m(self) -> np.ndarray:
        """[15] from each joint to the farthest point that it turns."""
        lengths = np.zeros(15)
        for joint in range(1, 16):
            last = 3 * ((joint - 1) // 3) + 3
            moved = (self.joint >= joint) & (self.joint <= last)
            lengths[joint - 1] = np.linalg.norm(self.rest[moved] - self.rest_joints[joint], axis=1).max()
        return lengths

    def posed(self, angles: np.ndarray) -> np.ndarray:
        """Pose the vertices: [B, N, 3] m of angles [B, 15, 3] rad, flexion, abduction and twist."""
        flexion, abduction, twist = np.moveaxis(angles, -1, 0)[..., None]
        turns = (
            axis_angle_to_matrix(flexion * self.axes.flexion[1:])
            @ axis_angle_to_matrix(abduction * self.axes.dorsal[1:])
            @ axis_angle_to_matrix(twist * self.axes.bone[1:])
        )
        rotations = torch.eye(3).repeat(len(angles), 16, 1, 1)
        rotations[:, 1:] = torch.as_tensor(turns, dtype=torch.float32)
        transforms = joint_transforms(rotations, self._joints.expand(len(angles), 16, 3), self._skin.parents)
        blended = (self._skin.lbs_weights @ transforms[..., :3, :].flatten(-2)).unflatten(-1, (3, 4))
        shaped = self._template + pose_correctives(self._skin, rotations)
        return ((blended[..., :3] @ shaped[..., None])[..., 0] + blended[..., 3]).numpy().astype(np.float64)

    def points(self, vertices: np.ndarray, which: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Find points [..., P, 3] of posed vertices [..., N, 3]; `which` of them."""
        corners, shares = self.corners[which], self.shares[which]
        a, b, c = (vertices[..., corners[:, k], :] * shares[:, k, None] for k in range(3))
        return a + b + c

    def normals(self, vertices: np.ndarray) -> np.ndarray:
        """Compute unit normals [P, 3] of the points of posed vertices [N, 3]."""
        of_vertices = area_weighted_normals(vertices, self.faces)
        blended = self.points(of_vertices)
        return blended / np.maximum(np.linalg.norm(blended, axis=1, keepdims=True), 1e-12)


def _faces_of(faces: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Return the faces all of whose corners are among some ascending vertices, numbered among these."""
    inside = faces[np.isin(faces, vertices).all(1)]
    return np.searchsorted(vertices, inside)


def _points(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """List corners and shares [P, 3] of vertices, edges' middles and faces' centres, in this order."""
    own = np.repeat(np.arange(count)[:, None], 3, 1)
    edges = np.unique(np.sort(half_edges(faces), 1), axis=0)
    middles = np.concatenate([edges, edges[:, :1]], 1)
    corners = np.concatenate([own, middles, faces])
    shares = np.concatenate(
        [np.tile([1.0, 0, 0], (count, 1)), np.tile([0.5, 0.5, 0], (len(edges), 1)), np.full((len(faces), 3), 1 / 3)]
    )
    return corners, shares


def _subset(model: HandModel, vertices: np.ndarray) -> SkinTensors:
    """Take the skinning of some vertices; the joints are known otherwise."""
    skin = SkinTensors.of(model)
    which = torch.as_tensor(vertices)
    return skin._replace(
        v_template=skin.v_template[which], lbs_weights=skin.lbs_weights[which], posedirs=skin.posedirs[which]
    )
