"""Which vertices of a mesh are one, which hang together, and where its surface is open or torn. Arrays in and out."""

from __future__ import annotations

import numpy as np


def welded(vertices: np.ndarray, faces: np.ndarray, distance: float) -> np.ndarray:
    """[N] the first vertex that lies in the same place, for vertices on open edges; others are themselves.

    Files that keep a normal or a texture coordinate per vertex split the surface along every seam.
    """
    first = np.arange(len(vertices))
    open_vertices = np.unique(open_half_edges(faces))
    for shift in (0.0, 0.5):  # a place on the border of two cells of one grid is inside a cell of the other
        cells = np.floor(vertices[open_vertices] / distance + shift).astype(np.int64)
        _, kind = np.unique(cells, axis=0, return_inverse=True)
        lowest = np.full(kind.max(initial=-1) + 1, len(vertices))
        np.minimum.at(lowest, kind.ravel(), first[open_vertices])
        first[open_vertices] = lowest[kind.ravel()]
    return first[first]


def half_edges(faces: np.ndarray) -> np.ndarray:
    """[3 F, 2] of all faces, in the direction of their winding."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def open_half_edges(faces: np.ndarray) -> np.ndarray:
    """[E, 2] half edges that no other face runs along the other way."""
    halves = half_edges(faces)
    forward, backward = _codes(halves)
    return halves[~np.isin(forward, backward)]


def torn_half_edges(faces: np.ndarray) -> np.ndarray:
    """[E, 2] half edges that two faces run along the same way: more than two meet there, or one is wound wrongly."""
    halves = half_edges(faces)
    _, index, count = np.unique(_codes(halves)[0], return_index=True, return_counts=True)
    return halves[index[count > 1]]


def pinched_vertices(faces: np.ndarray) -> np.ndarray:
    """Vertices at which an open edge meets itself."""
    starts, count = np.unique(open_half_edges(faces)[:, 0], return_counts=True)
    return starts[count > 1]


def components(faces: np.ndarray, count: int) -> np.ndarray:
    """[count] the lowest vertex of all those that a vertex hangs together with."""
    lowest = np.arange(count)
    edges = half_edges(faces)
    while True:
        before = lowest.copy()
        np.minimum.at(lowest, edges[:, 0], before[edges[:, 1]])
        np.minimum.at(lowest, edges[:, 1], before[edges[:, 0]])
        lowest = lowest[lowest]
        if (lowest == before).all():
            return lowest


def _codes(halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = int(halves.max(initial=0)) + 1
    return halves @ np.array([size, 1]), halves @ np.array([1, size])
