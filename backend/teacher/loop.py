"""Loop's subdivision as sparse matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.loop import loop_step, split_corners
from ..geometry.mesh_tables import half_edges
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
        step = loop_step(faces, count)
        entries = step.value, (step.row, step.column)
        matrix = sparse.csr_array(sparse.csr_array(entries, shape=(step.vertex_count, count)) @ matrix)
        faces, count, uv = step.faces, step.vertex_count, split_corners(uv)
    return Subdivision(matrix, faces, uv)


def neighbour_mean(faces: np.ndarray, vertex_count: int) -> sparse.csr_array:
    """Compute [N, N] matrix that replaces every vertex by the mean of its neighbours."""
    adjacent = _adjacency(half_edges(faces), vertex_count)
    adjacent.data[:] = 1.0  # each edge was counted once per face and direction
    return sparse.csr_array(sparse.diags_array(1 / adjacent.sum(1)) @ adjacent)


def _adjacency(edges: np.ndarray, vertex_count: int) -> sparse.csr_array:
    """Count how often each edge of [E, 2] occurs: [V, V], symmetric."""
    both = np.vstack([edges, edges[:, ::-1]])
    return sparse.csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(vertex_count, vertex_count))
