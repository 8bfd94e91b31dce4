"""Where a tracker sees its landmarks on our hand: its points are not our joints and fingertips.

A constant offset per landmark in the frame of the bone that ends there, metres on a hand of the mean shape. MediaPipe's
were learnt on made takes, in which the truth is known: `examples/learn_landmarks.py` makes and learns them again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .skeleton import PosedSkeleton

_ROUNDS = 4
_DEVIATION, _HUBER = 0.018, 2.0  # of the landmarks, as in the fit
_PRIOR = 100.0  # m^-2 a frame: what the picture never shows stays small


@dataclass(frozen=True)
class TrackerDefinition:
    """The offsets of a tracker's landmarks.

    Attributes:
        offsets_m: [21, 3] from each node, in the frame of the bone that ends in it; the wrist's and the knuckles' in
            the palm's.
    """

    offsets_m: np.ndarray

    @classmethod
    def of_joints(cls) -> TrackerDefinition:
        """Of a tracker that means our joints and fingertips."""
        return cls(np.zeros((21, 3)))

    def points(self, posed: PosedSkeleton) -> np.ndarray:
        """[T, 21, 3] m the landmarks of a posed hand."""
        rotations = bone_rotations(posed)
        return posed.nodes + (rotations @ self.offsets_m[..., None])[..., 0]


def bone_rotations(posed: PosedSkeleton) -> np.ndarray:
    """[T, 21, 3, 3] world rotation of the bone that ends in each node."""
    wrist = posed.rotations[:, 0, :1]
    return np.concatenate([wrist, posed.rotations.reshape(len(wrist), 20, 3, 3)], 1)


def learnt_definition(
    nodes: np.ndarray, rotations: np.ndarray, places: np.ndarray, size: np.ndarray
) -> TrackerDefinition:
    """The offsets that best explain, in the picture, where a tracker saw hands of known pose; robust least squares.

    Args:
        nodes: [N, 21, 3] m, true nodes in the camera's axes.
        rotations: [N, 21, 3, 3] true rotations of the bones that end in them.
        places: [N, 21, 2] (px - principal point) / focal length, of the tracker's landmarks at the nodes.
        size: [N] of the hand in the picture, divided by the focal length too.
    """
    offsets = np.zeros((21, 3))
    scale = 1 / (_DEVIATION * size[:, None, None])
    for _ in range(_ROUNDS):
        points = nodes + (rotations @ offsets[..., None])[..., 0]
        depth, seen = points[..., 2:], points[..., :2] / points[..., 2:]
        residual = (places - seen) * scale
        slopes = (rotations[..., :2, :] - seen[..., None] * rotations[..., 2:, :]) / depth[..., None] * scale[..., None]
        trust = np.minimum(1, _HUBER / np.maximum(np.linalg.norm(residual, axis=-1), 1e-9))[..., None]
        prior = len(nodes) * _PRIOR * np.eye(3)
        matrix = np.einsum("tnij,tnik->njk", slopes * trust[..., None], slopes) + prior
        right = np.einsum("tnij,tni->nj", slopes * trust[..., None], residual) - offsets @ prior
        offsets = offsets + np.linalg.solve(matrix, right[..., None])[..., 0]
    return TrackerDefinition(offsets)


# fmt: off
MEDIAPIPE_DEFINITION = TrackerDefinition(np.array([
        [-8.4, -1.2, 0.3],
        [0.3, 1.3, -0.1],
        [2.8, 1.7, -0.7],
        [4.0, 0.3, -0.4],
        [5.0, 2.5, -0.1],
        [2.5, 0.2, -0.4],
        [5.0, 4.0, -0.8],
        [7.2, 2.0, 0.5],
        [7.8, 0.6, 2.8],
        [-0.3, -1.5, -1.0],
        [1.8, -0.9, -1.4],
        [1.8, -0.1, -0.5],
        [5.3, 3.3, -2.2],
        [1.1, -0.8, -0.4],
        [3.9, 1.4, -1.0],
        [6.4, 1.5, 0.7],
        [9.0, 1.9, 2.6],
        [-8.5, -8.2, 5.5],
        [0.1, 0.3, 0.6],
        [3.4, 0.6, -0.8],
        [5.4, 1.9, -4.4],
]) / 1000)
"""Of MediaPipe 0.10.21's networks, from 12 takes of 48 frames (seed 100); mm, at the skeleton's nodes."""
# fmt: on
