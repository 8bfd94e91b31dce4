"""Rays through the shell: as `field.sampler` and `field.surface_tracking`.

A ray's intervals, its samples, and the closest point of one part of the surface, found from a nearby face.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.tolerances import MAX_STEPS, MIN_DETERMINANT
from .compiled import compiled
from .compiled import compiled_part as part

_TINY, _0, _1, _2, _NOWHERE = (np.float32(value) for value in (MIN_DETERMINANT, 0, 1, 2, 1e6))


class ShellCrossings(NamedTuple):
    """The rasterised shell over P pixels of a view.

    Attributes:
        depth: [P, L] crossings of the inflated mesh, nearest first, m.
        face: [P, L] their faces; a back face f is stored as -1 - f.
        counts: [P] number of crossings.
        inner: [P] depth of the deflated mesh's first front face, m; infinite where there is none.
        known: [P] depth of an avatar's surface, m; infinite where there is none.
        before: as `field.sampler.BEFORE_M`, m.
        behind: as `field.sampler.BEHIND_M`, m.
        least_reach: as `field.sampler.LEAST_REACH_M`, m.
    """

    depth: np.ndarray
    face: np.ndarray
    counts: np.ndarray
    inner: np.ndarray
    known: np.ndarray
    before: np.float32
    behind: np.float32
    least_reach: np.float32


class SurfaceTables(NamedTuple):
    """A posed mesh prepared for closest-point searches.

    Attributes:
        shapes: [F, 13] constants of each face (`face_shapes`).
        around: [F, 13, K] the same of the faces around each, side by side.
        neighbours: [F, 1 + K] each face and the faces around it.
        faces: [F, 3].
        vertices: [V, 3] m.
        normals: [V, 3].
    """

    shapes: np.ndarray
    around: np.ndarray
    neighbours: np.ndarray
    faces: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray


class Rays(NamedTuple):
    """Rays of a view: pixel [R], directions [R, 3] of depth 1, origins [R, 3] of depth 0, m."""

    pixel: np.ndarray
    directions: np.ndarray
    origins: np.ndarray


class TracedSamples(NamedTuple):
    """What traced rays are written to: t [R, N] m, dt [R] m, is_stopped [R], face [R, N], barycentric, height [R, N] m.

    `barycentric` is [R, N, 3]; heights are metres of the world.
    """

    t: np.ndarray
    dt: np.ndarray
    is_stopped: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    height: np.ndarray


@compiled
def find_live(crossings, first, last, is_live):
    """Mark the pixels in [first, last) whose rays have anything to sample."""
    start, end, since, part = ray_buffers(crossings)
    for pixel in range(first, last):
        if crossings.counts[pixel] > 0:
            _, total, _ = begin_ray(pixel, crossings, start, end, since, part)
            is_live[pixel] = total > _0


@compiled
def trace_samples(rays, offsets, crossings, surface, first, last, out):
    """Place the samples of rays [first, last) and project each onto the part of the surface that holds it deepest.

    `offsets` [R, N] in (0, 1) are the samples' positions in the union of a ray's intervals; `out` is `TracedSamples`.
    """
    samples = offsets.shape[1]
    start, end, since, part = ray_buffers(crossings)
    tried = np.empty((3, surface.around.shape[2]), np.float32)
    for ray in range(first, last):
        pixel = rays.pixel[ray]
        intervals, total, out.is_stopped[ray] = begin_ray(pixel, crossings, start, end, since, part)
        out.dt[ray] = total / np.float32(samples)
        for index in range(samples):
            interval, depth = put_sample(offsets[ray, index] * total, start, end, intervals)
            out.t[ray, index] = depth
            x, y, z = point_at(rays, ray, depth)
            face, wb, wc, height = deepest_part(x, y, z, depth, since[interval], pixel, crossings, surface, part, tried)
            out.face[ray, index], out.height[ray, index] = face, height
            out.barycentric[ray, index, 0] = _1 - wb - wc
            out.barycentric[ray, index, 1], out.barycentric[ray, index, 2] = wb, wc


@compiled
def ray_buffers(crossings):
    """Allocate a ray's buffers: starts, ends, `since` of its intervals, and the current face of each part entered."""
    capacity = crossings.depth.shape[1]
    start, end, since = np.empty(capacity, np.float32), np.empty(capacity, np.float32), np.empty(capacity, np.float32)
    return start, end, since, np.empty(capacity, np.int64)


@part
def begin_ray(pixel, crossings, start, end, since, part):
    """Fill a ray's buffers; returns (number of intervals, their total length, whether the ray ends opaque)."""
    depths, faces, count = crossings.depth[pixel], crossings.face[pixel], crossings.counts[pixel]
    for crossing in range(count):
        part[crossing] = faces[crossing]
    intervals, total, is_stopped = interval_list(depths, faces, count, crossings.inner[pixel], start, end)
    for index in range(intervals):
        since[index] = start[index]
    near, far = crossings.known[pixel] - crossings.before, crossings.known[pixel] + crossings.behind
    about, is_cut = _reach(near, far, start, end, intervals)
    if about > crossings.least_reach:  # nothing without an avatar's surface: `near` is infinite
        for index in range(intervals):
            start[index], end[index] = min(max(start[index], near), far), min(max(end[index], near), far)
        return intervals, about, is_stopped or is_cut
    return intervals, total, is_stopped


@part
def _reach(near, far, start, end, intervals):
    """Compute (length of the intervals from `near` to `far`, whether any goes on behind)."""
    total, is_cut = _0, False
    for index in range(intervals):
        total += max(min(end[index], far) - max(start[index], near), _0)
        is_cut = is_cut or end[index] > far
    return total, is_cut


@part
def point_at(rays, ray, depth):
    """Compute the point of a ray at a depth."""
    x = rays.origins[ray, 0] + depth * rays.directions[ray, 0]
    y = rays.origins[ray, 1] + depth * rays.directions[ray, 1]
    z = rays.origins[ray, 2] + depth * rays.directions[ray, 2]
    return x, y, z


@part
def deepest_part(x, y, z, depth, since, pixel, crossings, surface, part, tried):
    """Find (face, weight of b, weight of c, height m) of a sample, on the part of the surface that holds it deepest.

    Every part entered since the interval's start is tracked, from the face that `part` holds for it.
    """
    deepest, face, wb, wc = np.float32(np.inf), np.int64(0), _0, _0
    for crossing in range(crossings.counts[pixel]):
        entry = crossings.depth[pixel, crossing]
        if entry > depth:
            break
        if crossings.face[pixel, crossing] < 0 or entry < since:
            continue
        found, b, c, squared = closest_on_part(x, y, z, part[crossing], surface, tried)
        part[crossing] = found
        height = signed_height(x, y, z, found, b, c, squared, surface)
        if height < deepest:
            deepest, face, wb, wc = height, found, b, c
    return face, wb, wc, deepest


@part
def interval_list(depths, faces, count, inner, start, end):
    """Fill the intervals in which a ray is inside; returns (count, total length, whether the hand itself stops it)."""
    intervals, nesting = 0, 0
    for crossing in range(count):
        is_front = faces[crossing] >= 0
        nesting += 1 if is_front else -1
        if is_front and nesting <= 1:
            start[intervals] = depths[crossing]
            end[intervals] = _exit(depths, faces, count, crossing, nesting)
            intervals += 1
    total, is_stopped = np.float32(0), False
    for index in range(intervals):
        is_stopped = is_stopped or inner < end[index]
        start[index], end[index] = min(start[index], inner), min(end[index], inner)
        total += end[index] - start[index]
    return intervals, total, is_stopped


@part
def _exit(depths, faces, count, crossing, nesting):
    """Find the depth where nesting, given after `crossing`, returns to zero; the last crossing's if it never does."""
    while nesting > 0 and crossing + 1 < count:
        crossing += 1
        nesting += 1 if faces[crossing] >= 0 else -1
    return depths[crossing]


@part
def put_sample(offset, start, end, intervals):
    """Find (interval, depth) at an offset into the union of the intervals."""
    index = 0
    while index < intervals - 1 and offset > end[index] - start[index]:
        offset -= end[index] - start[index]
        index += 1
    return index, start[index] + offset


FACE_COLUMNS = 13
"""Of a row of a face's shape: corner a, edges ab and ac, ab.ab, ab.ac, ac.ac, 1/determinant."""


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
    """Find (face, weight of b, weight of c, distance^2) of the surface point nearest to (x, y, z), walking from `face`.

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
    """Try the closest points of all of a face's neighbours: computing all is faster than testing which are needed."""
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
    """Compute (distance^2, weight of b, weight of c) of the face's point nearest to (x, y, z)."""
    ax, ay, az = shapes[face, 0], shapes[face, 1], shapes[face, 2]
    bx, by, bz = shapes[face, 3], shapes[face, 4], shapes[face, 5]
    cx, cy, cz = shapes[face, 6], shapes[face, 7], shapes[face, 8]
    d00, d01, d11 = shapes[face, 9], shapes[face, 10], shapes[face, 11]
    return _closest(x - ax, y - ay, z - az, bx, by, bz, cx, cy, cz, d00, d01, d11, shapes[face, 12])


@part
def _closest(px, py, pz, bx, by, bz, cx, cy, cz, d00, d01, d11, inverse):
    """Compute (distance^2, weight of b, weight of c) of a triangle's point nearest to p, from corner a. No branches."""
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
    """Compute weights of b and c at the nearest point of the three edges; |p|^2, the same for all, is left out."""
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
    """Compute the distance, negative where the offset from the surface point opposes the interpolated normal."""
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
