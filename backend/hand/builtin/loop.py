"""Loop's subdivision of closed triangle meshes as sparse matrices (Loop 1987; weights for valence n are his own)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.mesh_tables import half_edges
from .dependencies import needs

with needs("scipy"):
    from scipy import sparse


class Subdivision(NamedTuple):
    """A subdivided mesh.

    Attributes:
        matrix: sparse [N, V], rows sum to 1; maps any field of the V coarse vertices to the N fine ones.
        faces: [M, 3].
        uv: [M, 3, 2] per face corner, interpolated linearly within the coarse faces.
    """

    matrix: sparse.csr_array
    faces: np.ndarray
    uv: np.ndarray


def subdivide(faces: np.ndarray, uv: np.ndarray, vertex_count: int, levels: int) -> Subdivision:
    """Split every triangle in four, `levels` times. faces [F, 3] of a closed mesh, uv [F, 3, 2] per corner."""
    matrix, count = sparse.csr_array(sparse.eye_array(vertex_count)), vertex_count
    for _ in range(levels):
        step, faces = _split(faces, count)
        count = int(faces.max()) + 1  # the last vertex is on an edge, hence in a face
        matrix = sparse.csr_array(step @ matrix)
        uv = _split_corners(uv)
    return Subdivision(matrix, faces, uv)


def neighbour_mean(faces: np.ndarray, vertex_count: int) -> sparse.csr_array:
    """[N, N] matrix that replaces every vertex by the mean of its neighbours."""
    adjacent = _adjacency(half_edges(faces), vertex_count)
    adjacent.data[:] = 1.0  # each edge was counted once per face and direction
    return sparse.csr_array(sparse.diags_array(1 / adjacent.sum(1)) @ adjacent)


def _split(faces: np.ndarray, vertex_count: int) -> tuple[sparse.csr_array, np.ndarray]:
    """One level: the matrix [V + E, V] (old vertices, then one per edge) and the faces [4 F, 3]."""
    sides = np.sort(half_edges(faces), 1)
    opposite = np.r_[faces[:, 2], faces[:, 0], faces[:, 1]]
    edges, edge_of_side = np.unique(sides, axis=0, return_inverse=True)
    edge_of_side = edge_of_side.ravel()
    matrix = sparse.vstack(
        [_moved_vertices(edges, vertex_count), _edge_points(edges, edge_of_side, opposite, vertex_count)]
    )
    return sparse.csr_array(matrix), _split_faces(faces, vertex_count + edge_of_side.reshape(3, -1).T)


def _edge_points(
    edges: np.ndarray, edge_of_side: np.ndarray, opposite: np.ndarray, vertex_count: int
) -> sparse.csr_array:
    """[E, V]: 3/8 of each end and 1/8 of the two opposite corners."""
    count = len(edges)
    rows = np.r_[np.repeat(np.arange(count), 2), edge_of_side]
    columns = np.r_[edges.ravel(), opposite]
    values = np.r_[np.full(2 * count, 3 / 8), np.full(len(opposite), 1 / 8)]
    return sparse.csr_array((values, (rows, columns)), shape=(count, vertex_count))


def _moved_vertices(edges: np.ndarray, vertex_count: int) -> sparse.csr_array:
    """[V, V]: each old vertex moved towards its neighbours."""
    adjacent = _adjacency(edges, vertex_count)
    valence = adjacent.sum(1)
    share = (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence
    return sparse.csr_array(sparse.diags_array(1 - valence * share) + sparse.diags_array(share) @ adjacent)


def _adjacency(edges: np.ndarray, vertex_count: int) -> sparse.csr_array:
    """[V, V] symmetric, the number of times each edge of [E, 2] occurs."""
    both = np.vstack([edges, edges[:, ::-1]])
    return sparse.csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(vertex_count, vertex_count))


def _split_faces(faces: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """The three corner faces, then the middle ones; middles [F, 3] are the new vertices on sides 01, 12, 20."""
    (a, b, c), (ab, bc, ca) = faces.T, middles.T
    return np.vstack([np.stack(corner, 1) for corner in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])


def _split_corners(uv: np.ndarray) -> np.ndarray:
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(corner, 1) for corner in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
