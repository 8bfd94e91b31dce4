"""The surface on which values on a grid are zero, as triangles: marching tetrahedra.

Every cube of the grid is cut into six tetrahedra around its diagonal (Kuhn's), in the same way everywhere, so that the
triangles of neighbours meet: the surface is closed but where it leaves the grid. A tetrahedron is cut by a triangle, or
by a quadrangle of two (Doi and Koide 1991); unlike in marching cubes no case is ambiguous.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ..records.errors import LiveHandError

_LEAST = 2  # points of the grid along each axis
# Corners of the triangles by which inside corners are: each corner of a triangle lies on an edge (inside, outside).
_ONE = ((0, 1), (0, 2), (0, 3))
_TWO = (((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2)))


def zero_surface(values: np.ndarray, origin: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Extract the surface between positive values, inside, and others.

    Args:
        values: [X, Y, Z] on a grid.
        origin: [3] of the first value.
        spacing: of the grid, in the same unit.

    Returns:
        Vertices [N, 3] and faces [M, 3], counter-clockwise seen from outside; none where all values have one sign.

    Raises:
        LiveHandError: the grid has fewer than 2 points along an axis, or values that are not finite.
    """
    if values.ndim != 3 or min(values.shape) < _LEAST or not np.isfinite(values).all():
        raise LiveHandError(f"a grid must have 2 x 2 x 2 finite values or more, got {list(values.shape)}")
    flat = values.ravel().astype(np.float64)
    corners = _cut_tetrahedra(values)
    edges = _triangles(corners, flat[corners] > 0)
    keys, faces = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    inside, outside = flat[keys[:, 0]], flat[keys[:, 1]]
    share = (inside / np.where(inside == outside, 1, inside - outside))[:, None]
    ends = [np.stack(np.unravel_index(keys[:, end], values.shape), -1) for end in (0, 1)]
    vertices = origin + spacing * (ends[0] + share * (ends[1] - ends[0]))
    return vertices, _outward(vertices, faces.reshape(-1, 3), ends[1] - ends[0])


def _cut_tetrahedra(values: np.ndarray) -> np.ndarray:
    """List the tetrahedra [T, 4] that the surface cuts, by their corners' places in the flattened grid."""
    is_inside = values > 0
    cells = [slice(None, -1), slice(1, None)]
    every = np.stack([is_inside[cells[x], cells[y], cells[z]] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    x, y, z = np.nonzero(every.any(0) & ~every.all(0))
    strides = np.array([values.shape[1] * values.shape[2], values.shape[2], 1])
    first = x * strides[0] + y * strides[1] + z
    steps = np.array([np.cumsum([0, *strides[list(order)]]) for order in permutations(range(3))])
    tetrahedra = (first[:, None, None] + steps).reshape(-1, 4)
    inside = is_inside.ravel()[tetrahedra]
    return tetrahedra[inside.any(1) & ~inside.all(1)]


def _triangles(corners: np.ndarray, is_inside: np.ndarray) -> np.ndarray:
    """Cut the tetrahedra: [M, 3, 2] edges (inside, outside) on which triangles' corners lie."""
    order = np.argsort(~is_inside, 1, kind="stable")  # inside corners first
    ordered, count = np.take_along_axis(corners, order, 1), is_inside.sum(1)
    one, three = ordered[count == 1], ordered[count == 3]
    parts = [one[:, _ONE], three[:, [(b, a) for a, b in ((3, 0), (3, 1), (3, 2))]]]
    parts += [ordered[count == 2][:, triangle] for triangle in _TWO]
    return np.concatenate(parts).astype(np.int64)


def _outward(vertices: np.ndarray, faces: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Turn faces to where the grid's edges through their corners lead, [N, 3] from inside."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    is_turned = (np.cross(b - a, c - a) * outward[faces].sum(1)).sum(-1) < 0
    faces[is_turned] = faces[is_turned][:, ::-1]
    return faces
