"""The 21 landmarks of a right hand model as functions of shape and pose, with derivatives, in numpy.

Fingers are in MANO's order (index, middle, pinky, ring, thumb). Each has four nodes: three joints and a tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...hand.joint_axes import anatomical_axes
from ...hand.model import HandModel
from ...records.shot import HandPose

NODES_OF_LANDMARKS = (0, 17, 18, 19, 20, 1, 2, 3, 4, 5, 6, 7, 8, 13, 14, 15, 16, 9, 10, 11, 12)
"""The node of each of MediaPipe's landmarks, which are the wrist and then thumb, index, middle, ring and pinky."""
_LEAST_TIP_WEIGHT = 0.5  # of the last joint, for a vertex to be the fingertip


class PosedSkeleton(NamedTuple):
    """The nodes in T poses.

    Attributes:
        nodes: [T, 21, 3] m, the wrist first.
        rotations: [T, 5, 4, 3, 3] world rotations: of the wrist, then of each joint of a finger.
        axes: [T, 5, 3, 3, 3] world flexion, abduction and twist axes of each joint, in rows.
    """

    nodes: np.ndarray
    rotations: np.ndarray
    axes: np.ndarray


@dataclass(frozen=True)
class HandSkeleton:
    """The bones of a right hand.

    Attributes:
        rest: [21, 3] m, the nodes of the mean shape in the template's frame.
        shape: [21, 3, 10] m per unit of beta.
        axes: [5, 3, 3, 3] unit flexion, abduction and twist axes of each joint, in rows.
    """

    rest: np.ndarray
    shape: np.ndarray
    axes: np.ndarray

    @classmethod
    def of(cls, model: HandModel) -> HandSkeleton:
        """Build the skeleton of a hand model; a left hand is mirrored."""
        right = model.for_side("right")
        regressor = np.concatenate([right.J_regressor[:1], *(_finger_rows(right, k) for k in range(5))])
        axes = anatomical_axes(right).reshape(5, 3, 3, 3)
        return cls(regressor @ right.v_template, np.einsum("nv,vck->nck", regressor, right.shapedirs), axes)

    def offsets(self, beta: np.ndarray) -> np.ndarray:
        """Compute [5, 4, 3] m: from the wrist to each finger's first joint, then from node to node."""
        return _steps(self.rest + self.shape @ beta)

    def pose(self, root: np.ndarray, transl: np.ndarray, angles: np.ndarray, offsets: np.ndarray) -> PosedSkeleton:
        """Compute the nodes in T poses.

        Args:
            root: [T, 3, 3] rotation of the wrist.
            transl: [T, 3] m, position of the wrist joint.
            angles: [T, 5, 3, 3] flexion, abduction and twist of each joint, rad.
            offsets: [5, 4, 3] m, from `offsets`.
        """
        rotations, axes = [np.broadcast_to(root[:, None], (len(root), 5, 3, 3))], []
        nodes = [transl[:, None] + _times(rotations[0], offsets[:, 0])]
        turns = np.moveaxis(_rotation(self.axes, angles), 3, 0)  # of flexion, abduction, twist: [T, 5, 3, 3, 3]
        for joint in range(3):
            flexion, abduction, twist = np.moveaxis(self.axes[:, joint], 1, 0)  # each [5, 3]
            parent = rotations[-1]
            flexed = parent @ turns[0][:, :, joint]
            abducted = flexed @ turns[1][:, :, joint]
            axes.append(np.stack([_times(parent, flexion), _times(flexed, abduction), _times(abducted, twist)], -2))
            rotations.append(abducted @ turns[2][:, :, joint])
            nodes.append(nodes[-1] + _times(rotations[-1], offsets[:, joint + 1]))
        fingers = np.stack(nodes, 2).reshape(len(root), 20, 3)
        return PosedSkeleton(np.concatenate([transl[:, None], fingers], 1), np.stack(rotations, 2), np.stack(axes, 2))

    def local_rotations(self, angles: np.ndarray) -> np.ndarray:
        """Compute [T, 15, 3, 3] local rotations of the finger joints, in MANO's order, from angles [T, 5, 3, 3]."""
        flexion, abduction, twist = np.moveaxis(_rotation(self.axes, angles), 3, 0)
        return (flexion @ abduction @ twist).reshape(len(angles), 15, 3, 3)

    def shape_terms(self, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose nodes relative to the wrist, linear in beta: of the mean shape [T, 21, 3], per beta [T, 21, 3, 10]."""
        of_rest = _chained(rotations, _steps(self.rest)[..., None])
        of_beta = _chained(rotations, _steps(self.shape))
        wrist = ((0, 0), (1, 0), (0, 0))
        return np.pad(of_rest[..., 0], wrist), np.pad(of_beta, (*wrist, (0, 0)))


def landmarks_of(model: HandModel, pose: HandPose) -> np.ndarray:
    """Return [21, 3] m, world: a posed hand's landmarks in MediaPipe's order, as `fit_landmarks` takes them."""
    from ...hand.lbs import posed_arrays  # with torch, which readers of files can do without

    vertices, joints = posed_arrays(model, pose)
    tips = vertices[tip_vertices(model)]
    fingers = [[*joints[3 * finger + 1 : 3 * finger + 4], tips[finger]] for finger in range(5)]
    return np.concatenate([joints[:1], *fingers])[list(NODES_OF_LANDMARKS)]


def tip_vertices(model: HandModel) -> np.ndarray:
    """Return [5] the vertex at the tip of each finger."""
    right = model.for_side("right")
    return np.array([np.argmax(_finger_rows(right, finger)[3]) for finger in range(5)])


def node_jacobian(posed: PosedSkeleton) -> np.ndarray:
    """Return the nodes' slopes [T, 21, 3, 51], m.

    They are per rad of the wrist's rotation about the world's axes, per m of its position, and per rad of each angle.
    """
    count = len(posed.nodes)
    wrist, fingers = posed.nodes[:, :1], posed.nodes[:, 1:].reshape(count, 5, 4, 3)
    jacobian = np.zeros((count, 21, 3, 51))
    jacobian[..., :3] = np.cross(np.eye(3), (posed.nodes - wrist)[:, :, None], axis=-1).swapaxes(-1, -2)
    jacobian[..., 3:6] = np.eye(3)
    blocks = np.zeros((count, 5, 4, 3, 9))
    for joint in range(3):
        arms = fingers[:, :, joint + 1 :] - fingers[:, :, joint : joint + 1]
        slopes = np.cross(posed.axes[:, :, joint, None], arms[:, :, :, None], axis=-1)  # [T, 5, n, 3 axes, 3]
        blocks[:, :, joint + 1 :, :, 3 * joint : 3 * joint + 3] = slopes.swapaxes(-1, -2)
    for finger in range(5):
        jacobian[:, 4 * finger + 1 : 4 * finger + 5, :, 6 + 9 * finger : 15 + 9 * finger] = blocks[:, finger]
    return jacobian


def _finger_rows(model: HandModel, finger: int) -> np.ndarray:
    """Return [4, V] regressor of a finger's three joints and its tip, which is one vertex.

    Where the last joint moves no vertices, as in a model of a rig without that joint, its bone ends as far behind it as
    the joint before lies ahead.
    """
    joints = slice(3 * finger + 1, 3 * finger + 4)
    last = 3 * finger + 3
    along = model.joints[last] - model.joints[last - 1]
    is_end = model.lbs_weights[:, last] > _LEAST_TIP_WEIGHT
    reach = np.where(is_end, (model.v_template - model.joints[last]) @ along, -np.inf)
    tip = np.zeros((1, len(model.v_template)))
    tip[0, np.argmax(reach)] = 1
    if not is_end.any():
        tip = 2 * model.J_regressor[[last]] - model.J_regressor[[last - 1]]
    return np.concatenate([model.J_regressor[joints], tip])


def _steps(nodes: np.ndarray) -> np.ndarray:
    """Return [5, 4, 3, ...] differences from node to node, the first from the wrist, of nodes [21, 3, ...]."""
    fingers = nodes[1:].reshape(5, 4, *nodes.shape[1:])
    before = np.concatenate([np.broadcast_to(nodes[0], fingers[:, :1].shape), fingers[:, :-1]], 1)
    return fingers - before


def _chained(rotations: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return [T, 20, 3, K] steps [5, 4, 3, K], each rotated by its own of [T, 5, 4, 3, 3], summed along the finger."""
    summed = np.cumsum(rotations @ steps, 2)
    return summed.reshape(len(rotations), 20, 3, steps.shape[-1])


def _rotation(axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    return axis_angle_to_matrix(axes * angles[..., None])


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (matrices @ vectors[..., None])[..., 0]
