"""Where a tracker sees its landmarks on our hand: its points are not our joints and fingertips.

A constant offset per landmark in the frame of the bone that ends there, metres on a hand of the mean shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .skeleton import PosedSkeleton


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
