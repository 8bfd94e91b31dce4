"""Tables of triangle meshes in numpy: half edges, neighbours, components, normals. Vertices [N, 3], faces [F, 3].

An edge of two faces wound alike is two opposite half edges, one of each face.
"""

from __future__ import annotations

import numpy as np

_MIN_LENGTH = 1e-12  # of a normal; below it the direction is undefined and the normal zero


def half_edges(faces: np.ndarray) -> np.ndarray:
    """List half edges [3 F, 2] in the direction of the faces' winding: first all 01, then all 12, then all 20."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def open_half_edges(faces: np.ndarray) -> np.ndarray:
    """Find the half edges [E, 2] without an opposite one: the boundary of the surface."""
    halves = half_edges(faces)
    forward, backward = _keys(halves)
    return halves[~np.isin(forward, backward)]


def repeated_half_edges(faces: np.ndarray) -> np.ndarray:
    """Find half edges [E, 2] of several faces: more than two faces meet there, or one is wound the wrong way."""
    halves = half_edges(faces)
    _, index, count = np.unique(_keys(halves)[0], return_index=True, return_counts=True)
    return halves[index[count > 1]]


def pinched_vertices(faces: np.ndarray) -> np.ndarray:
    """Find vertices at which the boundary touches itself."""
    starts, count = np.unique(open_half_edges(faces)[:, 0], return_counts=True)
    return starts[count > 1]


def connected_components(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Find the lowest vertex [N] of the component that each vertex belongs to."""
    lowest = np.arange(vertex_count)
    edges = half_edges(faces)
    while True:
        before = lowest.copy()
        np.minimum.at(lowest, edges[:, 0], before[edges[:, 1]])
        np.minimum.at(lowest, edges[:, 1], before[edges[:, 0]])
        lowest = lowest[lowest]
        if (lowest == before).all():
            return lowest


def merged_vertices(vertices: np.ndarray, faces: np.ndarray, distance: float) -> np.ndarray:
    """Find the vertex [N] to merge each into: the first in the same place for vertices on open edges, else itself.

    Files with a normal or texture coordinate per vertex split the surface along every seam.
    """
    first = np.arange(len(vertices))
    open_vertices = np.unique(open_half_edges(faces))
    for shift in (0.0, 0.5):  # two grids, so that no place lies at a cell's border in both
        cells = np.floor(vertices[open_vertices] / distance + shift).astype(np.int64)
        _, kind = np.unique(cells, axis=0, return_inverse=True)
        lowest = np.full(kind.max(initial=-1) + 1, len(vertices))
        np.minimum.at(lowest, kind.ravel(), first[open_vertices])
        first[open_vertices] = lowest[kind.ravel()]
    return first[first]


def neighbour_table(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Return the vertices [N, K] that share an edge with each, ascending, padded with the vertex itself."""
    pairs = half_edges(faces)
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    counts = np.bincount(pairs[:, 0], minlength=vertex_count)
    column = np.arange(len(pairs)) - (np.cumsum(counts) - counts)[pairs[:, 0]]
    table = np.repeat(np.arange(vertex_count)[:, None], counts.max(), 1)
    table[pairs[:, 0], column] = pairs[:, 1]
    return table


def area_weighted_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute [N, 3] unit vertex normals; zero for vertices without area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), _MIN_LENGTH)


def _keys(halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give each half edge a number, and its opposite another."""
    size = int(halves.max(initial=0)) + 1
    return halves @ np.array([size, 1]), halves @ np.array([1, size])
