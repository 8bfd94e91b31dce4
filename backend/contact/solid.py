"""The signed distance of any mesh, exact at its triangles: negative inside.

The side is told by the angle-weighted normal at the nearest point (Baerentzen and Aanaes 2005, "Signed Distance
Computation Using the Angle Weighted Pseudonormal"). Parts of a mesh that pass through each other count as one solid.

An open surface, such as a plane, counts from its front: what is behind it is inside, but beyond its rim is outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..geometry.mesh_tables import half_edges
from .oriented_mesh import OrientedPart, oriented_parts

if TYPE_CHECKING:
    from ..compute.kernels.nearest import TriangleTree

_ON_CORNER = 1e-9  # barycentric, below which a nearest point lies on an edge


class Distances(NamedTuple):
    """Of P points.

    Attributes:
        signed_m: [P] to the nearest surface, negative inside.
        outward: [P, 3] unit vectors along which it grows.
    """

    signed_m: np.ndarray
    outward: np.ndarray


class MeshSolid:
    """One or several meshes as one solid."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        """Prepare vertices [N, 3] m and triangles [F, 3]. Raises as `oriented_parts`."""
        self._parts = [_SearchedPart.of(part) for part in oriented_parts(vertices, faces)]
        self._low = np.array([part.low for part in self._parts])
        self._high = np.array([part.high for part in self._parts])

    @property
    def is_closed(self) -> bool:
        """Whether no part has a rim."""
        return all(part.is_closed for part in self._parts)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [3] of its box, m."""
        return self._low.min(0), self._high.max(0)

    def distances(self, points: np.ndarray) -> Distances:
        """Measure points [P, 3] m."""
        signed, outward = np.full(len(points), np.inf), np.zeros((len(points), 3))
        outside = np.maximum(np.maximum(self._low - points[:, None], points[:, None] - self._high), 0)  # [P, parts, 3]
        box_m = np.linalg.norm(outside, axis=2)
        for part in np.argsort(box_m.min(0, initial=np.inf)):
            near = np.flatnonzero(box_m[:, part] < np.maximum(signed, 1e-12))
            if not len(near):
                continue
            found = self._parts[part].distances(points[near])
            is_less = found.signed_m < signed[near]
            signed[near[is_less]], outward[near[is_less]] = found.signed_m[is_less], found.outward[is_less]
        return Distances(signed, outward)


@dataclass(frozen=True, eq=False)
class _SearchedPart:
    """An oriented part, and normals of its triangles' corners and edges.

    Attributes:
        corners: [F, 3, 3] m.
        normals: [F, 7, 3] of the face, of the edges opposite its corners, and of the corners; zero at a rim.
        tree: of the triangles.
        low: [3] corner of its box.
        high: [3] the other corner.
        is_closed: whether it has no rim.
    """

    corners: np.ndarray
    normals: np.ndarray
    tree: TriangleTree
    low: np.ndarray
    high: np.ndarray
    is_closed: bool

    @classmethod
    def of(cls, part: OrientedPart) -> _SearchedPart:
        from ..compute.kernels.nearest import triangle_tree

        corners = part.vertices[part.faces]
        low, high = part.vertices.min(0), part.vertices.max(0)
        return cls(corners, _normals(part), triangle_tree(corners), low, high, part.is_closed)

    def distances(self, points: np.ndarray) -> Distances:
        from ..compute.kernels.nearest import find_nearest

        points = np.ascontiguousarray(points)
        face, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
        find_nearest(points, self.tree, face, weights)
        offsets = np.einsum("pk,pkc->pc", weights, self.corners[face]) - points
        length = np.linalg.norm(offsets, axis=1)
        normal = self.normals[face, _feature(weights)]
        side = np.where(np.einsum("pc,pc->p", offsets, normal) <= 0, 1.0, -1.0)  # a rim's normal is zero: outside
        away = -side[:, None] * offsets / np.maximum(length, 1e-12)[:, None]
        outward = np.where((length > 1e-9)[:, None], away, self.normals[face, 0])
        return Distances(side * length, outward)


def _feature(weights: np.ndarray) -> np.ndarray:
    """Return [P] on what of a triangle a point [P, 3] lies: 0 within, 1 to 3 on an edge, 4 to 6 on a corner."""
    is_zero = weights < _ON_CORNER
    zeros = is_zero.sum(1)
    return np.where(zeros == 0, 0, np.where(zeros == 1, 1 + is_zero.argmax(1), 4 + (~is_zero).argmax(1)))


def _normals(part: OrientedPart) -> np.ndarray:
    """Compute [F, 7, 3] as `_SampledPart` has them; only their directions count."""
    corners = part.vertices[part.faces]
    a, b, c = corners.swapaxes(0, 1)
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    halves = np.sort(half_edges(part.faces), 1)  # of the edges 01, 12, 20 of all faces
    _, edge, count = np.unique(halves, axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    of_edges = np.zeros((len(count), 3))
    np.add.at(of_edges, edge, np.tile(face, (3, 1)))
    of_edges[count == 1] = 0
    of_corners = np.zeros((len(part.vertices), 3))
    for k in range(3):
        before, after = corners[:, k - 1] - corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        cosine = (before * after).sum(1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
        np.add.at(of_corners, part.faces[:, k], np.arccos(np.clip(cosine, -1, 1))[:, None] * face)
    of_corners[halves[count[edge] == 1]] = 0
    opposite = of_edges[edge.reshape(3, -1).T[:, [1, 2, 0]]]
    return np.concatenate([face[:, None], opposite, of_corners[part.faces]], 1)
