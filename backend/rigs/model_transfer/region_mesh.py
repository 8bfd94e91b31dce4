"""Closest points of a hand's surface, where each part is looked for on the same finger alone.

Neighbouring fingers nearly touch at rest: the closest point of a finger's side is often on the next finger.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree

from ...geometry.closest_point import closest_on_triangles
from ...geometry.mesh_tables import area_weighted_normals
from ...hand.model import HandModel

PALM = 0
"""The region of what no finger moves most; fingers are 1 to 5 in MANO's order."""
_GRID = 4  # samples along each side of a triangle, by which candidates are found
_CANDIDATES = 8
_CHUNK = 50_000  # points that are searched at a time


class NearestPoints(NamedTuple):
    """Points on a mesh: faces [N], barycentric weights [N, 3], and how far [N] m they are from what was looked for."""

    face: np.ndarray
    weights: np.ndarray
    distance_m: np.ndarray

    def blended(self, corners: np.ndarray) -> np.ndarray:
        """Blend values [F, 3, C] of the faces' corners: [N, C]."""
        return np.einsum("nk,nkc->nc", self.weights, corners[self.face])


@dataclass(frozen=True)
class RegionMesh:
    """A mesh whose faces belong to regions.

    Attributes:
        vertices: [V, 3] m.
        faces: [F, 3].
        regions: [V] of the vertices.
    """

    vertices: np.ndarray
    faces: np.ndarray
    regions: np.ndarray

    @classmethod
    def of(cls, model: HandModel, vertices: np.ndarray) -> RegionMesh:
        """Divide a posed or unposed hand."""
        return cls(vertices, model.f, vertex_regions(model))

    @cached_property
    def normals(self) -> np.ndarray:
        """[V, 3] unit."""
        return area_weighted_normals(self.vertices, self.faces)

    @cached_property
    def face_regions(self) -> np.ndarray:
        """[F] of each face: its first finger's, if any."""
        return self.regions[self.faces].max(1)

    def nearest(self, points: np.ndarray, regions: np.ndarray) -> NearestPoints:
        """Find the closest points to points [N, 3] of regions [N]: of a finger, on that finger or on the palm."""
        face, weights = np.zeros(len(points), np.int64), np.zeros((len(points), 3))
        distance = np.zeros(len(points))
        for region in np.unique(regions):
            for rows in np.array_split(*_chunks(np.flatnonzero(regions == region))):
                face[rows], weights[rows], distance[rows] = self._nearest_of(points[rows], int(region))
        return NearestPoints(face, weights, distance)

    def _nearest_of(self, points: np.ndarray, region: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tree, face_of = self._trees[region]
        _, at = tree.query(points, _CANDIDATES)
        candidates = face_of[at]  # [N, K]
        corners = torch.as_tensor(self.vertices[self.faces[candidates]])
        weights, squared = closest_on_triangles(torch.as_tensor(points)[:, None], corners)
        best, row = squared.argmin(1).numpy(), np.arange(len(points))
        return candidates[row, best], weights.numpy()[row, best], np.sqrt(squared.numpy()[row, best])

    @cached_property
    def _trees(self) -> dict[int, tuple[KDTree, np.ndarray]]:
        found = {}
        for region in np.unique(self.regions):
            faces = np.arange(len(self.faces))
            if region != PALM:
                faces = np.flatnonzero(np.isin(self.face_regions, (region, PALM)))
            samples = np.einsum("sk,fkc->fsc", _SAMPLES, self.vertices[self.faces[faces]])
            found[int(region)] = KDTree(samples.reshape(-1, 3)), np.repeat(faces, len(_SAMPLES))
        return found


def vertex_regions(model: HandModel) -> np.ndarray:
    """Return the region [V] of each vertex: the finger whose joints move it most, or the palm."""
    of_fingers = model.lbs_weights[:, 1:].reshape(-1, 5, 3).sum(2)
    return np.concatenate([model.lbs_weights[:, :1], of_fingers], 1).argmax(1)


def _chunks(rows: np.ndarray) -> tuple[np.ndarray, int]:
    return rows, 1 + len(rows) // _CHUNK


def _samples() -> np.ndarray:
    """Return barycentric weights [S, 3] of a grid inside a triangle."""
    first, second = (values.ravel() for values in np.mgrid[:_GRID, :_GRID])
    inside = first + second < _GRID
    a, b = (first[inside] + 1 / 3) / _GRID, (second[inside] + 1 / 3) / _GRID
    return np.stack([a, b, 1 - a - b], 1)


_SAMPLES = _samples()
