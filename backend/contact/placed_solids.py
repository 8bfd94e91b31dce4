"""Solids where a hand meets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..hand.model import MIRROR_POINT
from .solid import Distances, MeshSolid


@dataclass(frozen=True, eq=False)
class PlacedSolid:
    """A solid, and the rotation or reflection [3, 3] and the place [3] m that take its space to another."""

    solid: MeshSolid
    rotation: np.ndarray
    place: np.ndarray
    name: str = "the object"

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray, name: str = "the object") -> PlacedSolid:
        """Make a solid where its vertices [N, 3] m are. Raises as `MeshSolid`."""
        return cls(MeshSolid(vertices, faces), np.eye(3), np.zeros(3), name)

    def moved(self, rotation: np.ndarray, place: np.ndarray) -> PlacedSolid:
        """Move it on, by a rotation or reflection [3, 3] and then by a place [3] m."""
        return replace(self, rotation=rotation @ self.rotation, place=rotation @ self.place + place)

    def mirrored(self) -> PlacedSolid:
        """Mirror it at the plane x = 0."""
        return self.moved(np.diag(MIRROR_POINT), np.zeros(3))

    def distances(self, points: np.ndarray) -> Distances:
        """Measure points [P, 3] m."""
        found = self.solid.distances((points - self.place) @ self.rotation)
        return Distances(found.signed_m, found.outward @ self.rotation.T)


class Solids:
    """Several placed solids as one."""

    def __init__(self, solids: Sequence[PlacedSolid]):
        """Take at least one."""
        self._solids = tuple(solids)

    @property
    def names(self) -> str:
        """What they are called, for messages."""
        return ", ".join(one.name for one in self._solids)

    def moved(self, rotation: np.ndarray, place: np.ndarray) -> Solids:
        """Move all, as `PlacedSolid.moved`."""
        return Solids([one.moved(rotation, place) for one in self._solids])

    def mirrored(self) -> Solids:
        """Mirror all at the plane x = 0."""
        return Solids([one.mirrored() for one in self._solids])

    def distances(self, points: np.ndarray) -> Distances:
        """Measure points [P, 3] m to the nearest of them, or to the one that they are deepest in."""
        first, *others = (one.distances(points) for one in self._solids)
        for other in others:
            is_less = other.signed_m < first.signed_m
            first = Distances(
                np.where(is_less, other.signed_m, first.signed_m),
                np.where(is_less[:, None], other.outward, first.outward),
            )
        return first
