"""Where the joints of a hand are in each frame, by forward kinematics in numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...hand.bones import rest_forearm
from ...hand.model import MIRROR_POINT, PARENTS, HandModel
from ..landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton
from ..motion import HandMotion

JOINT_NODES = (0, *(4 * finger + k for finger in range(5) for k in (1, 2, 3)))
TIP_NODES = tuple(4 * finger + 4 for finger in range(5))


class PosedJoints(NamedTuple):
    """A hand in T frames.

    Attributes:
        nodes: [T, 21, 3] m, the wrist, then three joints and the tip of each finger in MANO's order.
        rotations: [T, 16, 3, 3] of the joints from the template's frame to the motion's space.
    """

    nodes: np.ndarray
    rotations: np.ndarray

    @property
    def landmarks(self) -> np.ndarray:
        """[T, 21, 3] m in MediaPipe's order."""
        return self.nodes[:, list(NODES_OF_LANDMARKS)]


class RestSkeleton(NamedTuple):
    """A shape at rest in the template's frame, m: nodes [..., 21, 3], and where the arm begins [..., 3] or None."""

    nodes: np.ndarray
    elbow: np.ndarray | None

    @classmethod
    def of(cls, model: HandModel, betas: np.ndarray) -> RestSkeleton:
        """Measure a model in shapes [..., 10]."""
        skeleton = HandSkeleton.of(model)
        nodes = skeleton.rest + np.einsum("nck,...k->...nc", skeleton.shape, betas)
        nodes = nodes if model.side == "right" else nodes * MIRROR_POINT
        if not model.has_arm:
            return cls(nodes, None)
        arm = rest_forearm(model)
        return cls(nodes, nodes[..., 0, :] + arm.head - arm.tail)


def pose_joints(motion: HandMotion, model: HandModel, scale: float = 1.0) -> PosedJoints:
    """Pose the joints of a model of the motion's side, the hand being `scale` times as large as its model."""
    rest = RestSkeleton.of(model, motion.betas).nodes
    local = axis_angle_to_matrix(motion.theta)
    rotations = np.empty_like(local)
    nodes = np.empty_like(rest)
    rotations[:, 0], nodes[:, 0] = local[:, 0], rest[:, 0] + motion.transl
    for joint in range(1, 16):
        above, node = PARENTS[joint], JOINT_NODES[joint]
        rotations[:, joint] = rotations[:, above] @ local[:, joint]
        nodes[:, node] = _ahead(nodes, rest, scale, rotations[:, above], (JOINT_NODES[above], node))
    for tip in TIP_NODES:
        last = rotations[:, JOINT_NODES.index(tip - 1)]
        nodes[:, tip] = _ahead(nodes, rest, scale, last, (tip - 1, tip))
    return PosedJoints(nodes, rotations)


def _ahead(
    nodes: np.ndarray, rest: np.ndarray, scale: float, rotations: np.ndarray, pair: tuple[int, int]
) -> np.ndarray:
    """Place the second node of a pair [T, 3], which the first carries."""
    start, end = pair
    step = scale * (rest[:, end] - rest[:, start])
    return nodes[:, start] + (rotations @ step[..., None])[..., 0]
