"""Equals `light.bounce.SkinPlaces.of`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .compiled import compiled_part as part

_0, _TINY = np.float32(0), np.float32(1e-20)


@compiled
def skin_places(vertices, faces, face, position, first, last, vertex, weight):
    """Fill vertex [R, 3] and weight [R, 3] of points [first, last) at position [R, 3]; face [R], -1 for none."""
    for index in range(first, last):
        row, of_face = np.uintp(index), np.uintp(max(face[index], 0))
        a, b, c = faces[of_face, 0], faces[of_face, 1], faces[of_face, 2]
        vertex[row, 0], vertex[row, 1], vertex[row, 2] = a, b, c
        nx, ny, nz = _cross(vertices, a, b, vertices[c, 0], vertices[c, 1], vertices[c, 2])
        x, y, z = position[row, 0], position[row, 1], position[row, 2]
        of_a = _area(vertices, b, c, x, y, z, nx, ny, nz)
        of_b = _area(vertices, c, a, x, y, z, nx, ny, nz)
        of_c = _area(vertices, a, b, x, y, z, nx, ny, nz)
        total = max(of_a + of_b + of_c, _TINY)
        is_beside = face[index] < 0
        weight[row, 0] = _0 if is_beside else of_a / total
        weight[row, 1] = _0 if is_beside else of_b / total
        weight[row, 2] = _0 if is_beside else of_c / total


@part
def _area(vertices, start, end, x, y, z, nx, ny, nz):
    """What the triangle of an edge and a point spans along a normal, at least 0."""
    cx, cy, cz = _cross(vertices, start, end, x, y, z)
    return max(cx * nx + cy * ny + cz * nz, _0)


@part
def _cross(vertices, start, end, x, y, z):
    """(end - start) x (point - start)."""
    ux, uy, uz = vertices[start, 0], vertices[start, 1], vertices[start, 2]
    vx, vy, vz = vertices[end, 0] - ux, vertices[end, 1] - uy, vertices[end, 2] - uz
    x, y, z = x - ux, y - uy, z - uz
    return vy * z - vz * y, vz * x - vx * z, vx * y - vy * x
