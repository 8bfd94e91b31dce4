"""The bone whose location moves a hand: the wrist's, or the forearm's if the hand has an arm.

The forearm turns about the elbow's end, so its location depends on its rotation as well as on transl.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .hand import RiggedHand


@dataclass(frozen=True, eq=False)
class Carrier:
    """The bone that carries a hand; its rotations are in armature space.

    Attributes:
        bone: the bone.
        frame: [3, 3] its rest orientation.
        reach: [3] m from its head to the wrist at rest; zeros if it is the wrist.
    """

    bone: bpy.types.PoseBone
    frame: np.ndarray
    reach: np.ndarray

    @classmethod
    def of(cls, hand: RiggedHand) -> Carrier:
        """Find the bone that carries this hand."""
        bone, wrist = hand.forearm or hand.bone(0), hand.bone(0)
        reach = np.array(wrist.bone.head_local, np.float64) - np.array(bone.bone.head_local, np.float64)
        return cls(bone, np.array(bone.bone.matrix_local.to_3x3(), np.float64), reach)

    @property
    def rotation(self) -> np.ndarray:
        """[3, 3] its own rotation, of its channels."""
        own = np.array(self.bone.matrix_basis.to_quaternion().to_matrix(), np.float64)
        return self.frame @ own @ self.frame.T

    @property
    def transl(self) -> np.ndarray:
        """[3] m that its channels move the wrist by."""
        return self.transls(np.array(self.bone.location, np.float64), self.rotation)

    def locations(self, transls: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """Compute location channels [..., 3] that move the wrist by transls [..., 3] m under rotations [..., 3, 3]."""
        return (np.asarray(transls, np.float64) - self._swings(rotations)) @ self.frame

    def transls(self, locations: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """Compute [..., 3] m that location channels [..., 3] move the wrist by under rotations [..., 3, 3]."""
        return locations @ self.frame.T + self._swings(rotations)

    def _swings(self, rotations: np.ndarray) -> np.ndarray:
        """Compute [..., 3] m that rotations alone move the wrist by."""
        return rotations @ self.reach - self.reach
