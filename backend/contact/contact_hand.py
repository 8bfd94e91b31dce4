"""A hand's skin as points that may touch things, posed many times quickly, in the frame of its unturned wrist.

Points are the vertices of the hand without its arm, the middles of their edges and the centres of their faces. Digits
are in MANO's order: index, middle, little, ring, thumb; 5 is the palm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.mesh_tables import area_weighted_normals, half_edges
from ..hand.gestures import FingerAxes
from ..hand.joint_axes import finger_axes
from ..hand.joint_limits import usual_limits_deg
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
    _template: np.ndarray
    _weights: np.ndarray
    _correctives: np.ndarray
    _parents: tuple[int, ...]

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
            rest_joints=right.J_regressor @ shape,
            _template=shape[vertices],
            _weights=right.lbs_weights[vertices],
            _correctives=right.posedirs[vertices].astype(np.float32),
            _parents=tuple(int(parent) for parent in right.parents),
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

    def posed(self, angles: np.ndarray, which: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Pose vertices [K], all or `which`: [B, K, 3] m of angles [B, 15, 3] rad, flexion, abduction and twist."""
        rotations = self._rotations(angles)
        features = (rotations - np.eye(3)).reshape(len(angles), -1).astype(np.float32)
        correctives = self._correctives[which]
        offsets = (features @ correctives.reshape(-1, features.shape[1]).T).reshape(len(angles), -1, 3)
        blended = (self._weights[which] @ self._transforms(rotations)).reshape(len(angles), -1, 3, 4)
        rest = self._template[which] + offsets
        return np.matmul(blended[..., :3], rest[..., None])[..., 0] + blended[..., 3]

    def points(self, vertices: np.ndarray) -> np.ndarray:
        """Find all points [P, 3] of posed vertices [N, 3]; of other values of vertices, those between them."""
        return np.einsum("pk,pkc->pc", self.shares, vertices[self.corners])

    def some_points(self, angles: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Pose some points [K]: [B, K, 3] m of angles [B, 15, 3] rad."""
        needed, corners = np.unique(self.corners[which], return_inverse=True)
        at = self.posed(angles, needed)[:, corners.reshape(-1, 3)]
        return (at * self.shares[which][..., None]).sum(2)

    def normals(self, vertices: np.ndarray) -> np.ndarray:
        """Compute unit normals [P, 3] of the points of posed vertices [N, 3]."""
        a, b, c = (vertices[self.faces[:, corner]] for corner in range(3))
        across, corners = np.cross(b - a, c - a), self.faces.ravel()
        around = [np.bincount(corners, np.repeat(across[:, axis], 3), len(vertices)) for axis in range(3)]
        return _unit(self.points(_unit(np.stack(around, 1))))

    @cached_property
    def _turns(self) -> np.ndarray:
        """[3, 15, 3, 3] whose products with a vector are the cross products of the joints' axes with it."""
        x, y, z = np.moveaxis(np.stack([self.axes.flexion[1:], self.axes.dorsal[1:], self.axes.bone[1:]]), -1, 0)
        zero = np.zeros_like(x)
        return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(3, 15, 3, 3)

    def _rotations(self, angles: np.ndarray) -> np.ndarray:
        """Turn by flexion, abduction and twist: [B, 15, 3, 3] of angles [B, 15, 3] rad."""
        angle, cross = np.moveaxis(angles, -1, 1)[..., None, None], self._turns
        flexion, abduction, twist = np.moveaxis(
            np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross), 1, 0
        )
        return flexion @ abduction @ twist

    def _transforms(self, rotations: np.ndarray) -> np.ndarray:
        """Compose rest-to-pose transforms [B, 16, 12] along the tree from rotations [B, 15, 3, 3]."""
        transforms = np.empty((len(rotations), 16, 3, 4))
        transforms[:, 0] = np.eye(3, 4)
        for joint in range(1, 16):
            before, at = transforms[:, self._parents[joint]], self.rest_joints[joint]
            transforms[:, joint, :, :3] = before[..., :3] @ rotations[:, joint - 1]
            transforms[:, joint, :, 3] = before[..., :3] @ at + before[..., 3] - transforms[:, joint, :, :3] @ at
        return transforms.reshape(len(rotations), 16, 12)


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


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
