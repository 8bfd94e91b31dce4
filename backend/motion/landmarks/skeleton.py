"""The 21 landmarks of a hand model as functions of shape and pose, with derivatives; for right hands, in numpy.

Fingers are in MANO's order (index, middle, pinky, ring, thumb); each has three joints and a tip, its four nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...hand.gestures import FingerAxes
from ...hand.model import HandModel
from ...hand.model_file import load_default_hand

NODES_OF_LANDMARKS = (0, 17, 18, 19, 20, 1, 2, 3, 4, 5, 6, 7, 8, 13, 14, 15, 16, 9, 10, 11, 12)
"""MediaPipe's 21 (wrist, thumb, index, middle, ring, pinky, each from knuckle to tip) among our nodes, which are the
wrist and four of each finger in MANO's order."""
_TIP_WEIGHT = 0.5  # of the last joint, from which on a vertex can be the tip


class Posed(NamedTuple):
    """T poses of the nodes.

    Attributes:
        nodes: [T, 21, 3] m, the wrist first.
        turned: [T, 5, 4, 3, 3] rotations above each finger's first joint and below each of its joints.
        axes: [T, 5, 3, 3, 3] of each joint: its flexion, abduction and twist axes as they now stand, in rows.
    """

    nodes: np.ndarray
    turned: np.ndarray
    axes: np.ndarray


@dataclass(frozen=True)
class Skeleton:
    """A right hand's bones.

    Attributes:
        rest: [21, 3] m, nodes of the mean shape in the template's frame.
        shape: [21, 3, 10] m per unit of beta.
        axes: [5, 3, 3, 3] unit flexion, abduction and twist axes of each joint, in rows.
    """

    rest: np.ndarray
    shape: np.ndarray
    axes: np.ndarray

    @classmethod
    def of(cls, model: HandModel) -> Skeleton:
        """Of any hand in MANO's format, either side: a left one is mirrored."""
        right = model.for_side("right")
        regressor = np.concatenate([right.J_regressor[:1], *(_finger_rows(right, k) for k in range(5))])
        return cls(regressor @ right.v_template, np.einsum("nv,vck->nck", regressor, right.shapedirs), _axes(right))

    def offsets(self, beta: np.ndarray) -> np.ndarray:
        """[5, 4, 3] m: from the wrist to each finger's first joint, and from node to node."""
        return _steps(self.rest + self.shape @ beta)

    def pose(self, root: np.ndarray, transl: np.ndarray, angles: np.ndarray, offsets: np.ndarray) -> Posed:
        """Nodes of T poses.

        Args:
            root: [T, 3, 3] rotation of the wrist.
            transl: [T, 3] m, of the wrist's joint itself.
            angles: [T, 5, 3, 3] flexion, abduction and twist of each joint, rad.
            offsets: [5, 4, 3] m, from `offsets`.
        """
        turned, axes = [np.broadcast_to(root[:, None], (len(root), 5, 3, 3))], []
        nodes = [transl[:, None] + _times(turned[0], offsets[:, 0])]
        for joint in range(3):
            flexion, abduction, twist = np.moveaxis(self.axes[:, joint], 1, 0)  # each [5, 3]
            above = turned[-1]
            bent = above @ _turn(flexion, angles[:, :, joint, 0])
            spread = bent @ _turn(abduction, angles[:, :, joint, 1])
            axes.append(np.stack([_times(above, flexion), _times(bent, abduction), _times(spread, twist)], -2))
            turned.append(spread @ _turn(twist, angles[:, :, joint, 2]))
            nodes.append(nodes[-1] + _times(turned[-1], offsets[:, joint + 1]))
        fingers = np.stack(nodes, 2).reshape(len(root), 20, 3)
        return Posed(np.concatenate([transl[:, None], fingers], 1), np.stack(turned, 2), np.stack(axes, 2))

    def local_rotations(self, angles: np.ndarray) -> np.ndarray:
        """[T, 15, 3, 3] each finger joint's own rotation, in MANO's order, of angles [T, 5, 3, 3]."""
        flexion, abduction, twist = (_turn(self.axes[:, :, k], angles[..., k]) for k in range(3))
        return (flexion @ abduction @ twist).reshape(len(angles), 15, 3, 3)

    def shape_terms(self, turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What nodes, counted from the wrist, are linear in: of the mean shape [T, 21, 3], per beta [T, 21, 3, 10]."""
        zero = np.zeros((len(turned), 1, 3))
        of_rest = _chained(turned, _steps(self.rest)[..., None])
        of_beta = _chained(turned, _steps(self.shape))
        return (
            np.concatenate([zero, of_rest[..., 0]], 1),
            np.concatenate([np.repeat(zero[..., None], 10, -1), of_beta], 1),
        )


def derivative_of_nodes(posed: Posed) -> np.ndarray:
    """[T, 21, 3, 51]: per rad of the wrist's turn about the world's axes, per m of its place, per rad of each angle."""
    count = len(posed.nodes)
    wrist, fingers = posed.nodes[:, :1], posed.nodes[:, 1:].reshape(count, 5, 4, 3)
    whole = np.zeros((count, 21, 3, 51))
    whole[..., :3] = np.cross(np.eye(3), (posed.nodes - wrist)[:, :, None], axis=-1).swapaxes(-1, -2)
    whole[..., 3:6] = np.eye(3)
    for finger in range(5):
        for joint in range(3):
            below = slice(4 * finger + joint + 2, 4 * finger + 5)
            arm = fingers[:, finger, joint + 1 :] - fingers[:, finger, joint : joint + 1]
            column = 6 + 9 * finger + 3 * joint
            turned = np.cross(posed.axes[:, finger, joint, None], arm[:, :, None], axis=-1)  # [T, n, 3 axes, 3]
            whole[:, below, :, column : column + 3] = turned.swapaxes(-1, -2)
    return whole


def _finger_rows(model: HandModel, finger: int) -> np.ndarray:
    """[4, V] what a finger's three joints and its tip are sums of."""
    joints = slice(3 * finger + 1, 3 * finger + 4)
    last = 3 * finger + 3
    along = model.joints[last] - model.joints[last - 1]
    is_end = model.lbs_weights[:, last] > _TIP_WEIGHT
    reach = np.where(is_end, (model.v_template - model.joints[last]) @ along, -np.inf)
    tip = np.zeros((1, len(model.v_template)))
    tip[0, np.argmax(reach)] = 1
    return np.concatenate([model.J_regressor[joints], tip])


def _axes(model: HandModel) -> np.ndarray:
    """[5, 3, 3, 3]: the built-in hand's axes, turned with the bones where another hand's lie otherwise."""
    builtin, axes = load_default_hand(), FingerAxes.of_default_hand()
    turn = _turns_between(_bones(builtin), _bones(model))
    three = np.stack([axes.flexion, axes.dorsal, axes.bone], 1)[1:]  # [15, 3, 3]
    return (three @ turn.swapaxes(-1, -2)).reshape(5, 3, 3, 3)


def _bones(model: HandModel) -> np.ndarray:
    """[15, 3] unit, from joint to joint; a finger's last goes on as the one before."""
    along = np.roll(model.joints[1:], -1, 0) - model.joints[1:]
    along[2::3] = along[1::3]
    return along / np.linalg.norm(along, axis=-1, keepdims=True)


def _turns_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """[N, 3, 3] the shortest turns between unit vectors [N, 3] that are not opposite."""
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), (start * end).sum(-1, keepdims=True)
    return axis_angle_to_matrix(axis / np.where(sine > 0, sine, 1) * np.arctan2(sine, cosine))


def _steps(nodes: np.ndarray) -> np.ndarray:
    """[5, 4, 3, ...] from node to node, the first from the wrist, of nodes [21, 3, ...]."""
    fingers = nodes[1:].reshape(5, 4, *nodes.shape[1:])
    before = np.concatenate([np.broadcast_to(nodes[0], fingers[:, :1].shape), fingers[:, :-1]], 1)
    return fingers - before


def _chained(turned: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """[T, 20, 3, K] the steps [5, 4, 3, K], each turned as `turned` [T, 5, 4, 3, 3], summed along the finger."""
    summed = np.cumsum(turned @ steps, 2)
    return summed.reshape(len(turned), 20, 3, steps.shape[-1])


def _turn(axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    return axis_angle_to_matrix(axes * angles[..., None])


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (matrices @ vectors[..., None])[..., 0]
