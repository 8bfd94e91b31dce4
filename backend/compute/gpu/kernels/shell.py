"""Rays through the shell: as `field.sampler` and `field.surface_tracking`.

A ray's crossings, intervals and faces lie in lists over the pixels, [L, P], so that neighbouring threads read and
write side by side. Lists have a capacity; a pixel with more crossings raises a flag.
"""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....geometry.tolerances import MAX_STEPS, MIN_DETERMINANT
from .compiled import INFINITE_BITS, Bools, Floats, Floats2, Ints, Ints2, Longs, Longs2, Vectors, Vectors2, kernel, part
from .raster import covered_centres, direction_of, fragment_depth, projected_area

wp.set_module_options({"fuse_fp": False})  # strict: which of two faces is the nearer hangs on the last bit
_TINY = wp.constant(MIN_DETERMINANT)
_MAX_STEPS = wp.constant(MAX_STEPS)
_FAR = wp.constant(3.0e38)
_INFINITE = wp.constant(INFINITE_BITS)


@kernel
@no_type_check
def find_crossings(
    outer: Vectors,
    inner: Vectors,
    faces: Longs2,
    lanes: int,
    width: int,
    height: int,
    counts: Ints,
    depth: Floats2,
    face_at: Ints2,
    stop_bits: Ints,
):
    """Append the crossings of the inflated mesh to their pixels' lists, and lower `stop_bits` to the deflated one's.

    A back face f is listed as -1 - f. `counts` goes on counting where a list is full.
    """
    face, lane = wp.tid()
    corner_a = int(faces[face, 0])
    corner_b = int(faces[face, 1])
    corner_c = int(faces[face, 2])
    a = outer[corner_a]
    b = outer[corner_b]
    c = outer[corner_c]
    area = projected_area(a, b, c)
    if area != 0.0:
        mark = face
        if area > 0.0:
            mark = -1 - face
        box = covered_centres(a, b, c, width, height)
        columns = box[1] - box[0]
        index = int(lane)
        while index < columns * (box[3] - box[2]):
            x = box[0] + index % columns
            y = box[2] + index / columns
            z = fragment_depth(a, b, c, area, float(x) + 0.5, float(y) + 0.5)
            if z > 0.0:
                slot = wp.atomic_add(counts, y * width + x, 1)
                if slot < depth.shape[0]:
                    depth[slot, y * width + x] = z
                    face_at[slot, y * width + x] = mark
            index += lanes
    a = inner[corner_a]
    b = inner[corner_b]
    c = inner[corner_c]
    area = projected_area(a, b, c)
    if area < 0.0:
        box = covered_centres(a, b, c, width, height)
        columns = box[1] - box[0]
        index = int(lane)
        while index < columns * (box[3] - box[2]):
            x = box[0] + index % columns
            y = box[2] + index / columns
            z = fragment_depth(a, b, c, area, float(x) + 0.5, float(y) + 0.5)
            if z > 0.0:
                wp.atomic_min(stop_bits, y * width + x, wp.cast(z, wp.int32))
            index += lanes


@part
@no_type_check
def _sort(depth: Floats2, face_at: Ints2, count: int, pixel: int):
    """Sort a pixel's list by depth, and by face where depths are equal: in no order of threads."""
    for index in range(1, count):
        z = depth[index, pixel]
        mark = face_at[index, pixel]
        slot = int(index)
        while slot > 0:
            before = depth[slot - 1, pixel]
            other = face_at[slot - 1, pixel]
            if before < z or (before == z and wp.max(other, -1 - other) <= wp.max(mark, -1 - mark)):
                break
            depth[slot, pixel] = before
            face_at[slot, pixel] = other
            slot -= 1
        depth[slot, pixel] = z
        face_at[slot, pixel] = mark


@part
@no_type_check
def _exit(depth: Floats2, face_at: Ints2, count: int, crossing: int, nesting: int, pixel: int) -> float:
    """Find the depth where nesting, given after `crossing`, returns to zero; the last crossing's if it never does."""
    at = int(crossing)
    inside = int(nesting)
    while inside > 0 and at + 1 < count:
        at += 1
        if face_at[at, pixel] >= 0:
            inside += 1
        else:
            inside -= 1
    return depth[at, pixel]


@kernel
@no_type_check
def fill_intervals(
    counts: Ints,
    depth: Floats2,
    face_at: Ints2,
    stop_bits: Ints,
    surface_m: Floats,
    reaches_m: Floats,
    most: int,
    start: Floats2,
    end: Floats2,
    since: Floats2,
    intervals: Ints,
    total: Floats,
    is_stopped: Bools,
    is_live: Bools,
    overflow: Ints,
):
    """Fill the intervals in which the rays of pixels are inside, of their `most` nearest crossings.

    `surface_m` is the depth of an avatar's surface, infinite where there is none; `reaches_m` are `BEFORE_M`,
    `BEHIND_M` and `LEAST_REACH_M` of `field.sampler` in metres of the world.
    """
    pixel = wp.tid()
    count = counts[pixel]
    if count > depth.shape[0]:
        overflow[0] = 1
        count = depth.shape[0]
    _sort(depth, face_at, count, pixel)
    count = wp.min(count, most)
    counts[pixel] = count
    inner = wp.cast(stop_bits[pixel], wp.float32)
    found = wp.int32(0)
    nesting = wp.int32(0)
    length = wp.float32(0.0)
    stopped = wp.bool(False)
    for crossing in range(count):
        is_front = face_at[crossing, pixel] >= 0
        if is_front:
            nesting += 1
        else:
            nesting -= 1
        if is_front and nesting <= 1:
            enter = depth[crossing, pixel]
            leave = _exit(depth, face_at, count, crossing, nesting, pixel)
            stopped = stopped or inner < leave
            enter = wp.min(enter, inner)
            leave = wp.min(leave, inner)
            start[found, pixel] = enter
            end[found, pixel] = leave
            since[found, pixel] = enter
            length += leave - enter
            found += 1
    near = surface_m[pixel] - reaches_m[0]
    far = surface_m[pixel] + reaches_m[1]
    about = wp.float32(0.0)
    is_cut = wp.bool(False)
    for index in range(found):
        about += wp.max(wp.min(end[index, pixel], far) - wp.max(start[index, pixel], near), 0.0)
        is_cut = is_cut or end[index, pixel] > far
    if about > reaches_m[2]:
        for index in range(found):
            start[index, pixel] = wp.min(wp.max(start[index, pixel], near), far)
            end[index, pixel] = wp.min(wp.max(end[index, pixel], near), far)
        length = about
        stopped = stopped or is_cut
    intervals[pixel] = found
    total[pixel] = length
    is_stopped[pixel] = stopped
    is_live[pixel] = length > 0.0


@kernel
@no_type_check
def face_corners(vertices: Vectors, faces: Longs2, corners: Vectors2):
    """Fill corners [F, 3] of faces, m."""
    face, corner = wp.tid()
    corners[face, corner] = vertices[int(faces[face, corner])]


@part
@no_type_check
def closest_on_face(point: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Compute (distance^2, weight of b, weight of c) of a triangle's point nearest to a point."""
    ab = b - a
    ac = c - a
    p = point - a
    d00 = wp.dot(ab, ab)
    d01 = wp.dot(ab, ac)
    d11 = wp.dot(ac, ac)
    inverse = 1.0 / wp.max(d00 * d11 - d01 * d01, _TINY)
    d1 = wp.dot(p, ab)
    d2 = wp.dot(p, ac)
    v = (d11 * d1 - d01 * d2) * inverse
    w = (d00 * d2 - d01 * d1) * inverse
    if not (v >= 0.0 and w >= 0.0 and v + w <= 1.0):
        along_ab = wp.clamp(d1 / wp.max(d00, _TINY), 0.0, 1.0)
        ab_score = along_ab * (along_ab * d00 - 2.0 * d1)
        along_ac = wp.clamp(d2 / wp.max(d11, _TINY), 0.0, 1.0)
        ac_score = along_ac * (along_ac * d11 - 2.0 * d2)
        along_bc = wp.clamp((d2 - d1 + d00 - d01) / wp.max(d00 - 2.0 * d01 + d11, _TINY), 0.0, 1.0)
        rest = 1.0 - along_bc
        bc_score = (
            rest * rest * d00
            + 2.0 * rest * along_bc * d01
            + along_bc * along_bc * d11
            - 2.0 * (rest * d1 + along_bc * d2)
        )
        v = along_ab
        w = wp.float32(0.0)
        if ac_score < ab_score:
            v = wp.float32(0.0)
            w = along_ac
        if bc_score < wp.min(ab_score, ac_score):
            v = rest
            w = along_bc
    offset = p - v * ab - w * ac
    return wp.vec3(wp.dot(offset, offset), v, w)


@part
@no_type_check
def signed_height(point: wp.vec3, faces: Longs2, vertices: Vectors, normals: Vectors, face: int, at: wp.vec3) -> float:
    """Compute the distance, negative where the offset from the surface point opposes the interpolated normal."""
    a = int(faces[face, 0])
    b = int(faces[face, 1])
    c = int(faces[face, 2])
    wa = 1.0 - at[1] - at[2]
    foot = wa * vertices[a] + at[1] * vertices[b] + at[2] * vertices[c]
    normal = wa * normals[a] + at[1] * normals[b] + at[2] * normals[c]
    height = wp.sqrt(at[0])
    if wp.dot(point - foot, normal) < 0.0:
        height = -height
    return height


@kernel
@no_type_check
def trace_samples(
    count: Ints,
    view: Vectors,
    width: int,
    pixel: Longs,
    offsets: Floats2,
    surface_m: Floats,
    counts: Ints,
    depth: Floats2,
    face_at: Ints2,
    start: Floats2,
    end: Floats2,
    since: Floats2,
    intervals: Ints,
    total: Floats,
    vertices: Vectors,
    normals: Vectors,
    faces: Longs2,
    neighbours: Longs2,
    corners: Vectors2,
    scale: Floats,
    t: Floats2,
    dt: Floats,
    face_out: Longs2,
    weights_out: Vectors2,
    height_out: Floats2,
):
    """Place the samples of rays and project each onto the part of the surface that holds it deepest.

    `offsets` [R, N] in (0, 1) are the samples' positions in the union of a ray's intervals. `face_at` keeps the face
    of each part that was entered as it is tracked. Heights are the template's. Rays beside the shell
    have samples without length at `surface_m`.
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    at = int(pixel[ray])
    samples = offsets.shape[1]
    crossings = counts[at]
    found = intervals[at]
    dt[ray] = total[at] / float(samples)
    if total[at] <= 0.0:
        for index in range(samples):
            t[ray, index] = surface_m[at]
            face_out[ray, index] = wp.int64(0)
            weights_out[ray, index] = wp.vec3(1.0, 0.0, 0.0)
            height_out[ray, index] = 0.0
        return
    direction = direction_of(view, at, width)
    for index in range(samples):
        rest = float(offsets[ray, index] * total[at])
        interval = wp.int32(0)
        while interval < found - 1 and rest > end[interval, at] - start[interval, at]:
            rest -= end[interval, at] - start[interval, at]
            interval += 1
        z = start[interval, at] + rest
        point = view[0] + z * direction
        t[ray, index] = z
        deepest = float(_FAR)
        of_face = wp.int32(0)
        best = wp.vec3()
        for crossing in range(crossings):
            entry = depth[crossing, at]
            if entry > z:
                break
            if face_at[crossing, at] < 0 or entry < since[interval, at]:
                continue
            face = int(face_at[crossing, at])
            nearest = closest_on_face(point, corners[face, 0], corners[face, 1], corners[face, 2])
            for _ in range(_MAX_STEPS):
                came_from = face
                for slot in range(1, neighbours.shape[1]):
                    other = int(neighbours[came_from, slot])
                    tried = closest_on_face(point, corners[other, 0], corners[other, 1], corners[other, 2])
                    if tried[0] < nearest[0]:
                        nearest = tried
                        face = other
                if face == came_from:
                    break
            face_at[crossing, at] = face
            height = signed_height(point, faces, vertices, normals, face, nearest)
            if height < deepest:
                deepest = height
                of_face = face
                best = nearest
        face_out[ray, index] = wp.int64(of_face)
        weights_out[ray, index] = wp.vec3(1.0 - best[1] - best[2], best[1], best[2])
        height_out[ray, index] = deepest / scale[0]
