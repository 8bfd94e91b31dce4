"""Loop's subdivision of closed triangle meshes (Loop 1987; weights for valence n are his own), as lists of weights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .mesh_tables import half_edges


class LoopStep(NamedTuple):
    """One level: every triangle is split in four.

    Attributes:
        row, column, value: [K] entries of the matrix [N, V] that maps any field of the V vertices to the N finer ones;
            duplicates add up, rows sum to 1. The old vertices come first, then one vertex per edge.
        faces: [4 F, 3] the three corner faces of all, then the middle ones.
        vertex_count: N.
    """

    row: np.ndarray
    column: np.ndarray
    value: np.ndarray
    faces: np.ndarray
    vertex_count: int


def loop_step(faces: np.ndarray, vertex_count: int) -> LoopStep:
    """Subdivide a closed mesh with faces [F, 3] once."""
    opposite = np.r_[faces[:, 2], faces[:, 0], faces[:, 1]]
    edges, middles, split = split_faces(faces, vertex_count)
    parts = [_moved_vertices(edges, vertex_count), _edge_points(edges, middles.T.ravel(), opposite)]
    row, column, value = (np.concatenate(entries) for entries in zip(*parts, strict=True))
    return LoopStep(row, column, value, split, vertex_count + len(edges))


class SplitFaces(NamedTuple):
    """F faces of a closed mesh of V vertices, each split in four.

    Attributes:
        edges: [E, 2] of the mesh; a vertex lies on each, after the V.
        middles: [F, 3] the vertices on the sides 01, 12, 20 of each face.
        faces: [4 F, 3] the three corner faces of all, then the middle ones.
    """

    edges: np.ndarray
    middles: np.ndarray
    faces: np.ndarray


def split_faces(faces: np.ndarray, vertex_count: int) -> SplitFaces:
    """Split the faces [F, 3] of a closed mesh."""
    edges, edge_of_side = np.unique(np.sort(half_edges(faces), 1), axis=0, return_inverse=True)
    middles = vertex_count + edge_of_side.reshape(3, -1).T
    (a, b, c), (ab, bc, ca) = faces.T, middles.T
    split = [np.stack(corner, 1) for corner in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    return SplitFaces(edges, middles, np.vstack(split))


def split_corners(uv: np.ndarray) -> np.ndarray:
    """Split corners [F, 3, 2] of faces into those of the next level's faces, [4 F, 3, 2]."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(corner, 1) for corner in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])


_Entries = tuple[np.ndarray, np.ndarray, np.ndarray]


def _edge_points(edges: np.ndarray, point_of_side: np.ndarray, opposite: np.ndarray) -> _Entries:
    """Weigh 3/8 of each end and 1/8 of the two opposite corners."""
    points = np.arange(len(edges)) + point_of_side.min()
    rows, columns = np.r_[np.repeat(points, 2), point_of_side], np.r_[edges.ravel(), opposite]
    return rows, columns, np.r_[np.full(edges.size, 3 / 8), np.full(len(opposite), 1 / 8)]


def _moved_vertices(edges: np.ndarray, vertex_count: int) -> _Entries:
    """Move each old vertex towards its neighbours."""
    valence = np.bincount(edges.ravel(), minlength=vertex_count)
    share = (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence
    own = np.arange(vertex_count)
    rows, columns = np.r_[own, edges[:, 0], edges[:, 1]], np.r_[own, edges[:, 1], edges[:, 0]]
    return rows, columns, np.r_[1 - valence * share, share[edges[:, 0]], share[edges[:, 1]]]
