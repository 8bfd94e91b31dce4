"""The avatar's surface: as `surface.detail_mesh.detail_mesh` and `surface.shading_detail.detailed_image`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....image.shading import MIN_ALPHA
from ....light.brdf import ROUGHNESS
from ....surface.albedo_ratio import RATIO_STEP
from ....surface.blood import BLOOD_LOG_ALBEDO, TIGHT_AT, TIGHT_FROM
from ....surface.detail_maps import BUMP, GLOSS_STEP, SHADE_STEP
from ....surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from ....surface.shading_detail import FOLD_LOG_ALBEDO, LEAST_COSINE, MOST_TAPS, ONE_TAP_MORE, SHARPER
from .compiled import Bytes2, Floats, Floats2, Floats3, Ints, Longs, Longs2, Pairs, Vectors, kernel, part

_TINY = wp.constant(1e-12)
_MIN_ALPHA, _GLOSS_AT = wp.constant(MIN_ALPHA), wp.constant(12)
_FLATTENED, _DEEPENED_FROM, _DEEPENED_BY = (wp.constant(v) for v in (FLATTENED, DEEPENED_FROM, DEEPENED_BY))
_LEAST_COSINE, _ONE_TAP_MORE, _SHARPER = (wp.constant(v) for v in (LEAST_COSINE, ONE_TAP_MORE, SHARPER))
_MOST_TAPS, _SHADE, _GLOSS, _BUMP_SHARE = (wp.constant(v) for v in (MOST_TAPS, SHADE_STEP, GLOSS_STEP, BUMP))
_RATIO_STEP, _ALPHA_SQUARED = wp.constant(RATIO_STEP), wp.constant(ROUGHNESS[1] ** 4)
_FOLD_RED, _FOLD_GREEN, _FOLD_BLUE = (wp.constant(float(value)) for value in FOLD_LOG_ALBEDO)
_BLOOD_RED, _BLOOD_GREEN, _BLOOD_BLUE = (wp.constant(float(value)) for value in BLOOD_LOG_ALBEDO)
TEXELS, TEXEL_M, BLURRED_LEVEL, SLOPE, FINER_BY = (wp.constant(value) for value in range(5))
"""Of the constants of a view: texels of the finest level in a pixel's width at 1 m; side of one of these, m; the level
that red light shows; a stored step of a slope, m; levels from there to the ratio's own."""
_PLACE = wp.constant(3)
_TIGHT_FROM, _OF_TIGHT = wp.constant(TIGHT_FROM), wp.constant(1 / (TIGHT_AT - TIGHT_FROM))
_Texel = wp.types.vector(length=12, dtype=wp.float32)


@kernel
@no_type_check
def finer_field(start: Longs, column: Longs, weight: Floats, values: Floats2, finer: Floats2):
    """Fill a finer field [N, C] from a field [V, C] by one level of subdivision."""
    row, channel = wp.tid()
    total = wp.float32(0.0)
    for entry in range(int(start[row]), int(start[row + 1])):
        total += weight[entry] * values[int(column[entry]), channel]
    finer[row, channel] = total


@part
@no_type_check
def _placed(values: Floats2, row: int, rest: wp.vec3) -> wp.vec3:
    """Move a vertex from its place at rest by the motion in its row of the field."""
    place = wp.vec3()
    for axis in range(3):
        at = _PLACE + 4 * axis
        place[axis] = (
            rest[0] * values[row, at] + rest[1] * values[row, at + 1] + rest[2] * values[row, at + 2]
        ) + values[row, at + 3]
    return place


@kernel
@no_type_check
def fine_vertices(values: Floats2, offset_m: Vectors, normals: Vectors, height_m: Floats, vertices: Vectors):
    """Fill vertices from their field, their offsets and what rises along their normals at rest."""
    row = wp.tid()
    rest = wp.vec3(values[row, 0], values[row, 1], values[row, 2]) + offset_m[row] + height_m[row] * normals[row]
    vertices[row] = _placed(values, row, rest)


@kernel
@no_type_check
def raised_vertices(
    values: Floats2,
    offset_m: Vectors,
    normals: Vectors,
    shares: Floats,
    start: Longs,
    part_of: Ints,
    raised_m: Floats,
    resting_m: Floats,
    vertices: Vectors,
):
    """Fill vertices as `fine_vertices`; what rises is listed as `surface.detail_surface.RaisedParts` does."""
    row = wp.tid()
    height_m = float(resting_m[row])
    for entry in range(int(start[row]), int(start[row + 1])):
        height_m += shares[part_of[entry]] * raised_m[entry]
    rest = wp.vec3(values[row, 0], values[row, 1], values[row, 2]) + offset_m[row] + height_m * normals[row]
    vertices[row] = _placed(values, row, rest)


@kernel
@no_type_check
def vertex_normals(vertices: Vectors, faces: Longs2, start: Longs, around: Longs, normals: Vectors):
    """Fill unit normals: the area-weighted mean of the faces around each vertex, in order."""
    row = wp.tid()
    total = wp.vec3()
    for entry in range(int(start[row]), int(start[row + 1])):
        face = int(around[entry])
        a = vertices[int(faces[face, 0])]
        total += wp.cross(vertices[int(faces[face, 1])] - a, vertices[int(faces[face, 2])] - a)
    normals[row] = total / wp.max(wp.length(total), _TINY)


@part
@no_type_check
def _texel_at(u: float, v: float, size: int) -> wp.vec4:
    """Find (column, row, share of the next column, share of the next row) of a point of a level."""
    x = wp.clamp(u * float(size) - 0.5, 0.0, float(size - 1))
    y = wp.clamp(v * float(size) - 0.5, 0.0, float(size - 1))
    column = wp.min(int(x), size - 2)
    row = wp.min(int(y), size - 2)
    return wp.vec4(float(column), float(row), x - float(column), y - float(row))


@part
@no_type_check
def _corner_weight(place: wp.vec4, corner: int) -> float:
    across = 1.0 - place[2]
    if corner % 2 == 1:
        across = place[2]
    up = 1.0 - place[3]
    if corner / 2 == 1:
        up = place[3]
    return across * up


@part
@no_type_check
def _level_value(table: Bytes2, first: Longs, resolution: int, u: float, v: float, level: int) -> _Texel:
    """Look up a level's values, bilinear, in stored steps."""
    size = resolution >> level
    place = _texel_at(u, v, size)
    at = int(first[level]) + int(place[1]) * size + int(place[0])
    values = _Texel()
    for corner in range(4):
        texel = at + (corner / 2) * size + corner % 2
        weight = _corner_weight(place, corner)
        for k in range(12):
            values[k] += weight * float(table[texel, k])
    return values


@part
@no_type_check
def _sample(table: Bytes2, first: Longs, resolution: int, u: float, v: float, wanted: float) -> _Texel:
    """Look up the values at a point between two levels."""
    level = wp.clamp(wanted, 0.0, float(first.shape[0] - 1))
    fine = int(level)
    share = level - float(fine)
    values = (1.0 - share) * _level_value(table, first, resolution, u, v, fine)
    if share > 0.0:
        values += share * _level_value(table, first, resolution, u, v, fine + 1)
    return values


@part
@no_type_check
def _ratio_level(ratio: Bytes2, first: Longs, resolution: int, u: float, v: float, level: int) -> wp.vec3:
    size = resolution >> level
    place = _texel_at(u, v, size)
    at = int(first[level]) + int(place[1]) * size + int(place[0])
    values = wp.vec3()
    for corner in range(4):
        texel = at + (corner / 2) * size + corner % 2
        weight = _corner_weight(place, corner)
        values += weight * wp.vec3(float(ratio[texel, 0]), float(ratio[texel, 1]), float(ratio[texel, 2]))
    return values


@part
@no_type_check
def _bent(
    slopes: _Texel,
    surface: wp.vec3,
    dorsal: float,
    palmar: float,
    step_m: float,
    uv_b: wp.vec2,
    uv_c: wp.vec2,
    to_b: wp.vec3,
    to_c: wp.vec3,
) -> wp.vec3:
    """Bend the surface's unit normal by slopes; `to_b` and `to_c`: how the shares of corners grow along the face."""
    along_u = (slopes[0] - dorsal * slopes[2] - palmar * slopes[4]) * step_m
    along_v = (slopes[1] - dorsal * slopes[3] - palmar * slopes[5]) * step_m
    bent = surface + (along_u * uv_b[0] + along_v * uv_b[1]) * to_b + (along_u * uv_c[0] + along_v * uv_c[1]) * to_c
    return bent / wp.max(wp.length(bent), _TINY)


@part
@no_type_check
def _corner_uv(corner_uv: Floats3, face: int, corner: int) -> wp.vec2:
    return wp.vec2(corner_uv[face, corner, 0], corner_uv[face, corner, 1])


@part
@no_type_check
def _drained(drains: Floats, flex: Floats, vertex: int) -> float:
    """Compute the blood that a bend of the skin draws out of a vertex, as `surface.blood.tightness`."""
    share = wp.clamp((flex[vertex] - _TIGHT_FROM) * _OF_TIGHT, 0.0, 1.0)
    return drains[vertex] * share * share * (3.0 - 2.0 * share)


@kernel
@no_type_check
def add_skin(
    count: Ints,
    face_at: Longs,
    depth_at: Floats,
    coverage_at: Floats,
    view: Vectors,
    vertices: Vectors,
    vertex_normal: Vectors,
    faces: Longs2,
    corner_uv: Floats3,
    flex: Floats,
    table: Bytes2,
    first: Longs,
    resolution: int,
    ratio: Bytes2,
    ratio_first: Longs,
    ratio_resolution: int,
    constants: Floats,
    pigment_colour: Floats,
    drains: Floats,
    drains_log_albedo: Floats,
    pressed: Pairs,
    pixel: Longs,
    view_direction: Vectors,
    coefficients: Floats2,
    normal: Vectors,
    surface_normal: Vectors,
    blurred_normal: Vectors,
    alpha_squared: Floats,
    nails: Floats,
    alpha: Floats,
):
    """Give pixels [P] the coverage, normals, colours and nails of the skin, in place; a ratio of no rows is none.

    `drains` are the blood that bending draws out of vertices, and `drains_log_albedo` what 1 of it does to albedo;
    `pressed` are the shares of blood that has left skin and nails at vertices. Of both there may be none.
    """
    index = wp.tid()
    if index >= count[0]:
        return
    at = int(pixel[index])
    surface_normal[index] = normal[index]
    blurred_normal[index] = normal[index]
    alpha_squared[index] = _ALPHA_SQUARED
    nails[index] = 0.0
    coverage = coverage_at[at]
    share = coverage / wp.clamp(alpha[at], _MIN_ALPHA, 1.0)
    alpha[at] = coverage
    for k in range(_GLOSS_AT):
        coefficients[index, k] = coefficients[index, k] * share
    coefficients[index, _GLOSS_AT] = 0.0
    coefficients[index, _GLOSS_AT + 1] = coverage
    face = int(face_at[at])
    if face < 0:
        return
    corner_a = int(faces[face, 0])
    corner_b = int(faces[face, 1])
    corner_c = int(faces[face, 2])
    a = vertices[corner_a]
    b = vertices[corner_b] - a
    c = vertices[corner_c] - a
    n = wp.cross(b, c)
    squared = wp.dot(n, n)
    inverse = 1.0 / wp.max(squared, _TINY * _TINY)
    to_b = wp.cross(c, n) * inverse
    to_c = wp.cross(n, b) * inverse
    away = view_direction[index]
    facing = wp.dot(away, n)
    distance = wp.float32(0.0)
    if facing != 0.0:
        distance = wp.dot(a - view[0], n) / facing
    offset = view[0] + distance * away - a
    wb = wp.dot(offset, to_b)
    wc = wp.dot(offset, to_c)
    wa = 1.0 - wb - wc
    cosine = wp.max(wp.abs(facing) / wp.max(wp.sqrt(squared), _TINY), _LEAST_COSINE)
    uv_a = _corner_uv(corner_uv, face, 0)
    uv_b = _corner_uv(corner_uv, face, 1)
    uv_c = _corner_uv(corner_uv, face, 2)
    place = wa * uv_a + wb * uv_b + wc * uv_c
    uv_b = uv_b - uv_a
    uv_c = uv_c - uv_a
    bend = wa * flex[corner_a] + wb * flex[corner_b] + wc * flex[corner_c]
    # The direction in which the face is tilted, along it.
    into = facing * inverse
    tilt = wp.max(wp.sqrt(wp.max(1.0 - into * into * squared, 0.0)), _TINY)
    along = (away - into * n) / tilt
    depth = depth_at[at]
    step = (
        depth
        * constants[TEXELS]
        * constants[TEXEL_M]
        / cosine
        * (wp.dot(along, to_b) * uv_b + wp.dot(along, to_c) * uv_c)
    )
    mixed = wa * vertex_normal[corner_a] + wb * vertex_normal[corner_b] + wc * vertex_normal[corner_c]
    surface = mixed / wp.max(wp.length(mixed), _TINY)
    taps = wp.min(int(1.0 / cosine + _ONE_TAP_MORE), _MOST_TAPS)
    level = wp.log2(depth * constants[TEXELS]) - _SHARPER
    ratio_level = wp.clamp(level + constants[FINER_BY], 0.0, float(ratio_first.shape[0] - 1))
    fine = int(ratio_level)
    wider = ratio_level - float(fine)
    of_tap = 1.0 / float(taps)
    values = _Texel()
    log_ratio = wp.vec3()
    for tap in range(taps):
        aside = (float(tap) - 0.5 * float(taps - 1)) * of_tap
        u = place[0] + aside * step[0]
        v = place[1] + aside * step[1]
        values += of_tap * _sample(table, first, resolution, u, v, level)
        if ratio.shape[0] > 0:
            weight = _RATIO_STEP * of_tap
            log_ratio += weight * (1.0 - wider) * _ratio_level(ratio, ratio_first, ratio_resolution, u, v, fine)
            if wider > 0.0:
                log_ratio += weight * wider * _ratio_level(ratio, ratio_first, ratio_resolution, u, v, fine + 1)
    blurred = values
    if level < constants[BLURRED_LEVEL]:
        blurred = _sample(table, first, resolution, place[0], place[1], constants[BLURRED_LEVEL])
    dorsal = wp.max(1.0 - _FLATTENED * bend, 0.0)
    palmar = _DEEPENED_FROM + _DEEPENED_BY * bend
    normal[index] = _bent(values, surface, dorsal, palmar, constants[SLOPE], uv_b, uv_c, to_b, to_c)
    blurred_normal[index] = _bent(blurred, surface, dorsal, palmar, constants[SLOPE], uv_b, uv_c, to_b, to_c)
    surface_normal[index] = surface
    folds = dorsal * _BUMP_SHARE
    alpha_squared[index] = wp.max(values[10] + folds * folds * values[11], 1.0) * _GLOSS
    nail = values[9] * _SHADE
    nails[index] = nail
    coefficients[index, _GLOSS_AT] = nail * coverage
    coefficients[index, _GLOSS_AT + 1] = (1.0 - nail) * coverage
    folded = (dorsal * values[7] + palmar * values[8]) * _SHADE
    fold_colour = wp.vec3(_FOLD_RED, _FOLD_GREEN, _FOLD_BLUE)
    blood_colour = wp.vec3(_BLOOD_RED, _BLOOD_GREEN, _BLOOD_BLUE)
    bloodless = wp.float32(0.0)
    if pressed.shape[0] > 0:
        both = wa * pressed[corner_a] + wb * pressed[corner_b] + wc * pressed[corner_c]
        bloodless = wp.max(both[0], 0.0)
        bloodless += nail * (wp.max(bloodless, both[1]) - bloodless)
    of_joints = wp.float32(0.0)
    if drains.shape[0] > 0:
        of_corners = wb * _drained(drains, flex, corner_b) + wc * _drained(drains, flex, corner_c)
        of_joints = (1.0 - nail) * wp.max(wa * _drained(drains, flex, corner_a) + of_corners, 0.0)
    for k in range(3):
        pigment = values[6] * _SHADE * pigment_colour[k]
        left = bloodless * blood_colour[k] + of_joints * drains_log_albedo[k]
        factor = wp.exp(pigment + log_ratio[k] + folded * fold_colour[k] - left)
        for group in range(3):
            coefficients[index, 3 + 3 * group + k] = coefficients[index, 3 + 3 * group + k] * factor
