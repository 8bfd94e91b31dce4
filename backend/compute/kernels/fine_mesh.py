"""Equals `surface.fine_mesh.fine_mesh`: finer fields, level after level, then vertices and their normals."""

from __future__ import annotations

import numpy as np

from .compiled import compiled

_0, _TINY = np.float32(0), np.float32(1e-12)
COLUMNS = 16
"""Of a field: place at rest 3, transform 12 row by row, bend of the skin."""


@compiled
def finer_field(level, values, first, last, finer):
    """Fill rows [first, last) of a finer field [N, 16] from a field [V, 16]; `level` is a `FinerRows`."""
    for row in range(first, last):
        for k in range(COLUMNS):
            finer[row, k] = _0
        for entry in range(level.start[row], level.start[row + 1]):
            column, weight = level.column[entry], level.weight[entry]
            for k in range(COLUMNS):
                finer[row, k] += weight * values[column, k]


@compiled
def fine_vertices(values, offset_m, normals, height_m, first, last, vertices):
    """Fill vertices [first, last) from their field, their offsets and what rises along their normals at rest."""
    for row in range(first, last):
        x = values[row, 0] + offset_m[row, 0] + height_m[row] * normals[row, 0]
        y = values[row, 1] + offset_m[row, 1] + height_m[row] * normals[row, 1]
        z = values[row, 2] + offset_m[row, 2] + height_m[row] * normals[row, 2]
        for k in range(3):
            at = 3 + 4 * k
            turned = x * values[row, at] + y * values[row, at + 1] + z * values[row, at + 2]
            vertices[row, k] = turned + values[row, at + 3]


@compiled
def face_normals(vertices, faces, first, last, normals):
    """Fill the normals of faces [first, last), as long as twice their area."""
    for face in range(first, last):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        normals[face, 0] = uy * vz - uz * vy
        normals[face, 1] = uz * vx - ux * vz
        normals[face, 2] = ux * vy - uy * vx


@compiled
def vertex_normals(of_faces, start, around, first, last, normals):
    """Fill the unit normals of vertices [first, last) from those of the faces around each."""
    for row in range(first, last):
        x, y, z = _0, _0, _0
        for entry in range(start[row], start[row + 1]):
            face = around[entry]
            x += of_faces[face, 0]
            y += of_faces[face, 1]
            z += of_faces[face, 2]
        length = max(np.sqrt(x * x + y * y + z * z), _TINY)
        normals[row, 0], normals[row, 1], normals[row, 2] = x / length, y / length, z / length
