"""Equals `geometry.tracking`: the closest point of one part of the surface, found from a face nearby."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .tolerances import MAX_STEPS, MIN_DETERMINANT

FACE_COLUMNS = 13
"""Of a row of a face's shape: corner a, edges ab and ac, ab.ab, ab.ac, ac.ac, 1/determinant."""
DISC_ROWS = 7
"""Of the discs that hold faces: centre, unit normal, radius."""
LANES = 16
"""Neighbours are tested by so many at once: one register of the widest processors."""
_TINY, _0, _1, _2, _3 = (np.float32(value) for value in (MIN_DETERMINANT, 0, 1, 2, 3))
_NOWHERE = np.float32(1e6)


@compiled
def face_shapes(vertices, faces, first, last, shapes, discs):
    """Fill shapes [F, 13] and discs [F, 7] of faces [first, last): what their closest points need, once a frame."""
    for face in range(first, last):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        d00, d01, d11 = _0, _0, _0
        for k in range(3):
            ab, ac = vertices[b, k] - vertices[a, k], vertices[c, k] - vertices[a, k]
            shapes[face, k], shapes[face, 3 + k], shapes[face, 6 + k] = vertices[a, k], ab, ac
            discs[face, k] = (vertices[a, k] + vertices[b, k] + vertices[c, k]) / _3
            d00, d01, d11 = d00 + ab * ab, d01 + ab * ac, d11 + ac * ac
        shapes[face, 9], shapes[face, 10], shapes[face, 11] = d00, d01, d11
        determinant = max(d00 * d11 - d01 * d01, _TINY)
        shapes[face, 12] = _1 / determinant
        _add_normal(shapes, face, np.sqrt(determinant), discs)
        discs[face, 6] = _0
        for corner in (a, b, c):
            squared = _0
            for k in range(3):
                offset = vertices[corner, k] - discs[face, k]
                squared += offset * offset
            discs[face, 6] = max(discs[face, 6], np.sqrt(squared))


@compiled
def _add_normal(shapes, face, doubled_area, discs):
    """The cross product of a face's edges over its length, which is twice the area."""
    bx, by, bz = shapes[face, 3], shapes[face, 4], shapes[face, 5]
    cx, cy, cz = shapes[face, 6], shapes[face, 7], shapes[face, 8]
    discs[face, 3] = (by * cz - bz * cy) / doubled_area
    discs[face, 4] = (bz * cx - bx * cz) / doubled_area
    discs[face, 5] = (bx * cy - by * cx) / doubled_area


@compiled
def gather_discs(discs, neighbours, first, last, around):
    """Fill around [F, 7, K] for faces [first, last): the discs of their K neighbours, side by side."""
    for face in range(first, last):
        for slot in range(neighbours.shape[1]):
            other = neighbours[face, slot]
            for k in range(DISC_ROWS):
                around[face, k, slot] = discs[other, k] if other != face else _NOWHERE


@compiled
def closest_on_part(x, y, z, face, shapes, around, neighbours, bounds):
    """(face, weight of b, weight of c, distance^2) of the surface point nearest to (x, y, z), walking from `face`.

    `bounds` [K] is room for the neighbours' bounds.
    """
    squared, wb, wc = closest_on_face(x, y, z, face, shapes)
    for _ in range(MAX_STEPS):
        start = face
        _bound_neighbours(x, y, z, start, around, bounds)
        for slot in range(len(bounds)):
            if bounds[slot] < squared:
                other = neighbours[start, slot]
                got, b, c = closest_on_face(x, y, z, other, shapes)
                if got < squared:
                    squared, wb, wc, face = got, b, c, other
        if face == start:
            break
    return face, wb, wc, squared


@compiled
def _bound_neighbours(x, y, z, face, around, bounds):
    """Least distance^2 to the discs of a face's neighbours: up^2 + (across - radius)^2, seen from the disc's plane."""
    for slot in range(len(bounds)):
        dx, dy, dz = x - around[face, 0, slot], y - around[face, 1, slot], z - around[face, 2, slot]
        up = dx * around[face, 3, slot] + dy * around[face, 4, slot] + dz * around[face, 5, slot]
        across = np.sqrt(max(dx * dx + dy * dy + dz * dz - up * up, _0))
        beyond = max(across - around[face, 6, slot], _0)
        bounds[slot] = up * up + beyond * beyond


@compiled
def closest_on_face(x, y, z, face, shapes):
    """(distance^2, weight of b, weight of c) of the face's point nearest to (x, y, z)."""
    px, py, pz = x - shapes[face, 0], y - shapes[face, 1], z - shapes[face, 2]
    d1 = px * shapes[face, 3] + py * shapes[face, 4] + pz * shapes[face, 5]
    d2 = px * shapes[face, 6] + py * shapes[face, 7] + pz * shapes[face, 8]
    d00, d01, d11 = shapes[face, 9], shapes[face, 10], shapes[face, 11]
    v = (d11 * d1 - d01 * d2) * shapes[face, 12]
    w = (d00 * d2 - d01 * d1) * shapes[face, 12]
    if v < _0 or w < _0 or v + w > _1:
        v, w = _on_border(d1, d2, d00, d01, d11)
    dx = px - v * shapes[face, 3] - w * shapes[face, 6]
    dy = py - v * shapes[face, 4] - w * shapes[face, 7]
    dz = pz - v * shapes[face, 5] - w * shapes[face, 8]
    return dx * dx + dy * dy + dz * dz, v, w


@compiled
def _on_border(d1, d2, d00, d01, d11):
    """Weights of b and c at the nearest point of the three edges; |p|^2, the same for all, is left out."""
    s = min(max(d1 / max(d00, _TINY), _0), _1)
    best_v, best_w, best = s, _0, s * (s * d00 - _2 * d1)
    s = min(max(d2 / max(d11, _TINY), _0), _1)
    score = s * (s * d11 - _2 * d2)
    if score < best:
        best_v, best_w, best = _0, s, score
    # Along bc: b + s (c - b).
    s = min(max((d2 - d1 + d00 - d01) / max(d00 - _2 * d01 + d11, _TINY), _0), _1)
    v = _1 - s
    score = v * v * d00 + _2 * v * s * d01 + s * s * d11 - _2 * (v * d1 + s * d2)
    if score < best:
        best_v, best_w = v, s
    return best_v, best_w


@compiled
def signed_height(x, y, z, face, wb, wc, squared, faces, vertices, normals):
    """Distance, negative where the offset from the surface point goes against the interpolated normal."""
    wa = _1 - wb - wc
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    along = _0
    for k, point in enumerate((x, y, z)):
        surface = wa * vertices[a, k] + wb * vertices[b, k] + wc * vertices[c, k]
        normal = wa * normals[a, k] + wb * normals[b, k] + wc * normals[c, k]
        along += (point - surface) * normal
    distance = np.sqrt(squared)
    return -distance if along < _0 else distance
