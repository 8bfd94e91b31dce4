"""An object of the scene that may shadow or hide a hand: plain values, which may leave Blender's thread."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..hands.visible_hands import InstanceId
from .reach import bounding_balls

MESH_LIKE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
"""The types of objects that have triangles."""


@dataclass(frozen=True, eq=False)
class Solid:
    """One instance of an object; what is computed of it is kept.

    Attributes:
        instance_id: of the object.
        local: [T, 3, 3] its triangles in its own space.
        matrix: [4, 4] to the world.
        albedo: [T, 3] of its triangles, if they were diffuse.
    """

    instance_id: InstanceId
    local: np.ndarray
    matrix: np.ndarray
    albedo: np.ndarray

    @cached_property
    def triangles(self) -> np.ndarray:
        """[T, 3, 3] in the world, m."""
        return placed(self.local, self.matrix)

    @cached_property
    def balls(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres [T, 3] and radii [T] of balls around the triangles."""
        return bounding_balls(self.triangles)


def placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points [..., 3] moved by a matrix [4, 4]."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]
