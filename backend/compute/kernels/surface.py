"""Equals `field.surface_tracking`: the closest point of one part of the surface, found from a nearby face."""

from __future__ import annotations

import numpy as np

from ...geometry.tolerances import MAX_STEPS, MIN_DETERMINANT
from .compiled import compiled
from .compiled import compiled_part as part

FACE_COLUMNS = 13
"""Of a row of a face's shape: corner a, edges ab and ac, ab.ab, ab.ac, ac.ac, 1/determinant."""
_TINY, _0, _1, _2 = (np.float32(value) for value in (MIN_DETERMINANT, 0, 1, 2))
_NOWHERE = np.float32(1e6)


@compiled
def face_shapes(vertices, faces, first, last, shapes):
    """Fill shapes [F, 13] of faces [first, last): what their closest points need, once a frame."""
    for face in range(first, last):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        d00, d01, d11 = _0, _0, _0
        for k in range(3):
            ab, ac = vertices[b, k] - vertices[a, k], vertices[c, k] - vertices[a, k]
            shapes[face, k], shapes[face, 3 + k], shapes[face, 6 + k] = vertices[a, k], ab, ac
            d00, d01, d11 = d00 + ab * ab, d01 + ab * ac, d11 + ac * ac
        shapes[face, 9], shapes[face, 10], shapes[face, 11] = d00, d01, d11
        shapes[face, 12] = _1 / max(d00 * d11 - d01 * d01, _TINY)


@compiled
def gather_shapes(shapes, neighbours, first, last, around):
    """Fill around [F, 13, K] for faces [first, last): the shapes of the faces around them, side by side."""
    for face in range(first, last):
        for slot in range(around.shape[2]):
            other = neighbours[face, 1 + slot]
            for k in range(FACE_COLUMNS):
                around[face, k, slot] = shapes[other, k]
            if other == face:
                around[face, 0, slot] = _NOWHERE


@part
def closest_on_part(x, y, z, face, surface, tried):
    """(face, weight of b, weight of c, distance^2) of the surface point nearest to (x, y, z), walking from `face`.

    `tried` [3, K] is a buffer for the neighbours' distances^2 and weights.
    """
    squared, wb, wc = _closest_on_face(x, y, z, face, surface.shapes)
    for _ in range(MAX_STEPS):
        start = face
        _try_neighbours(x, y, z, start, surface.around, tried)
        for slot in range(tried.shape[1]):
            if tried[0, slot] < squared:
                squared, wb, wc = tried[0, slot], tried[1, slot], tried[2, slot]
                face = surface.neighbours[start, 1 + slot]
        if face == start:
            break
    return face, wb, wc, squared


@part
def _try_neighbours(x, y, z, face, around, tried):
    """The closest points of all of a face's neighbours: computing every one is faster than testing which are needed."""
    for slot in range(tried.shape[1]):
        ax, ay, az = around[face, 0, slot], around[face, 1, slot], around[face, 2, slot]
        bx, by, bz = around[face, 3, slot], around[face, 4, slot], around[face, 5, slot]
        cx, cy, cz = around[face, 6, slot], around[face, 7, slot], around[face, 8, slot]
        d00, d01, d11 = around[face, 9, slot], around[face, 10, slot], around[face, 11, slot]
        tried[0, slot], tried[1, slot], tried[2, slot] = _closest(
            x - ax, y - ay, z - az, bx, by, bz, cx, cy, cz, d00, d01, d11, around[face, 12, slot]
        )


@part
def _closest_on_face(x, y, z, face, shapes):
    """(distance^2, weight of b, weight of c) of the face's point nearest to (x, y, z)."""
    ax, ay, az = shapes[face, 0], shapes[face, 1], shapes[face, 2]
    bx, by, bz = shapes[face, 3], shapes[face, 4], shapes[face, 5]
    cx, cy, cz = shapes[face, 6], shapes[face, 7], shapes[face, 8]
    d00, d01, d11 = shapes[face, 9], shapes[face, 10], shapes[face, 11]
    return _closest(x - ax, y - ay, z - az, bx, by, bz, cx, cy, cz, d00, d01, d11, shapes[face, 12])


@part
def _closest(px, py, pz, bx, by, bz, cx, cy, cz, d00, d01, d11, inverse):
    """(distance^2, weight of b, weight of c) of a triangle's point nearest to p; all from corner a. No branches."""
    d1 = px * bx + py * by + pz * bz
    d2 = px * cx + py * cy + pz * cz
    v = (d11 * d1 - d01 * d2) * inverse
    w = (d00 * d2 - d01 * d1) * inverse
    border_v, border_w = _on_border(d1, d2, d00, d01, d11)
    is_inside = (v >= _0) & (w >= _0) & (v + w <= _1)
    v = v if is_inside else border_v
    w = w if is_inside else border_w
    dx = px - v * bx - w * cx
    dy = py - v * by - w * cy
    dz = pz - v * bz - w * cz
    return dx * dx + dy * dy + dz * dz, v, w


@part
def _on_border(d1, d2, d00, d01, d11):
    """Weights of b and c at the nearest point of the three edges; |p|^2, the same for all, is left out."""
    ab = min(max(d1 / max(d00, _TINY), _0), _1)
    ab_score = ab * (ab * d00 - _2 * d1)
    ac = min(max(d2 / max(d11, _TINY), _0), _1)
    ac_score = ac * (ac * d11 - _2 * d2)
    # Along bc: b + s (c - b).
    bc = min(max((d2 - d1 + d00 - d01) / max(d00 - _2 * d01 + d11, _TINY), _0), _1)
    rest = _1 - bc
    bc_score = rest * rest * d00 + _2 * rest * bc * d01 + bc * bc * d11 - _2 * (rest * d1 + bc * d2)
    is_ac = ac_score < ab_score
    v = _0 if is_ac else ab
    w = ac if is_ac else _0
    is_bc = bc_score < min(ab_score, ac_score)
    v = rest if is_bc else v
    w = bc if is_bc else w
    return v, w


@part
def signed_height(x, y, z, face, wb, wc, squared, surface):
    """Distance, negative where the offset from the surface point opposes the interpolated normal."""
    wa = _1 - wb - wc
    vertices, normals = surface.vertices, surface.normals
    a, b, c = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    along = _0
    for k, point in enumerate((x, y, z)):
        foot = wa * vertices[a, k] + wb * vertices[b, k] + wc * vertices[c, k]
        normal = wa * normals[a, k] + wb * normals[b, k] + wc * normals[c, k]
        along += (point - foot) * normal
    distance = np.sqrt(squared)
    return -distance if along < _0 else distance
