"""Equals `surface.shading_detail.detailed_image`.

Pixels are taken in blocks: what does not read the maps is the same arithmetic for all of them, side by side in rows,
and so in vector instructions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .series import grown, octaves
from .vectors import TEXEL, add_texels

_0, _HALF, _1, _TINY = (np.float32(value) for value in (0, 0.5, 1, 1e-12))
_SLOPES, _NAIL, _SQUARED, _HIDDEN_FOLDS = 6, 9, 10, 11
_COLOURS = 3  # where the coefficients of colours begin, RGB three times
_COLOURED = 3
_GLOSS = 12  # where that of both lobes begins
_BLOCK = 64
# Rows of a block. Of the faces' corners: position, u and v, normal and bend of the skin.
_A, _B, _C, _CORNER = 0, 9, 18, 9
_UV, _NORMAL, _FLEX = 3, 5, 8
_VIEW, _DEPTH = 27, 30
# How the shares of corners b and c grow along the face; what u and v are there against the first corner's.
_ALONG_B, _ALONG_C, _UV_B, _UV_C = 31, 34, 37, 39
# Position in the maps, a step along the tilt of the face, cosine of view and face, bend, the surface's normal.
_U, _V, _STEP, _COSINE, _BENT, _SURFACE = 41, 42, 43, 45, 46, 47
_SLOPES_AT, _BLURRED_AT = 50, 56  # slopes that were read, sharp and blurred
_BUMPED, _BLURRED = 62, 65  # normals
_ORIGIN, _LEVEL = 68, 71  # of the maps
_ROWS = 72


class VisibleFaces(NamedTuple):
    """What P pixels see of a surface.

    Attributes:
        face: [P] the first front face in the centre, -1 for none.
        coverage: [P].
        divisor: [P] what the camera divides lengths by there: the depth, m, or 1 where rays are parallel.
        origin_axes: [3, 3] what (x, y, 1) px is multiplied by to get a ray's point of depth 0, m.
        width: of the image, px.
    """

    face: np.ndarray
    coverage: np.ndarray
    divisor: np.ndarray
    origin_axes: np.ndarray
    width: int


class PosedSurface(NamedTuple):
    """A posed detail surface: N vertices, M faces.

    Attributes:
        vertices, normals: [N, 3] m, and unit.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        flex: [N] bend of the skin.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    flex: np.ndarray


class DetailTable(NamedTuple):
    """A pyramid of maps: table [T, 12] int8, the first row of each level, the resolution of the finest."""

    table: np.ndarray
    first: np.ndarray
    resolution: int


class RatioTable(NamedTuple):
    """A pyramid of the person's factor on albedo, logarithms RGB; without rows: there is none.

    Attributes:
        table, first, resolution: as in `DetailTable`.
        step: what a stored step is worth.
        finer_by: levels from the finest of the maps of detail to its own.
    """

    table: np.ndarray
    first: np.ndarray
    resolution: int
    step: np.float32
    finer_by: np.float32


class DetailConstants(NamedTuple):
    """Constants of `surface.shading_detail`.

    Attributes:
        least_alpha: of what is divided by it.
        texels: of the finest level in a pixel's width at a depth of 1 m.
        texel_m: side of one of these.
        least_cosine: of face and view.
        one_tap_more: as `ONE_TAP_MORE`.
        sharper: as `SHARPER`.
        blurred_level: of the maps, as red light shows them.
        flattened: what bending takes of dorsal folds.
        deepened_from: how much of palmar creases shows.
        deepened_by: what bending adds.
        bump: of a stored step of a slope, m.
        shade, gloss: what a stored step of shades and nails is worth, and of squared alphas.
        bump_share: as `BUMP`.
        most_taps: as `MOST_TAPS`.
        pigment_colour: [3].
        fold_log_albedo: [3].
    """

    least_alpha: np.float32
    texels: np.float32
    texel_m: np.float32
    least_cosine: np.float32
    one_tap_more: np.float32
    sharper: np.float32
    blurred_level: np.float32
    flattened: np.float32
    deepened_from: np.float32
    deepened_by: np.float32
    bump: np.float32
    shade: np.float32
    gloss: np.float32
    bump_share: np.float32
    most_taps: int
    pigment_colour: np.ndarray
    fold_log_albedo: np.ndarray


class DetailedArrays(NamedTuple):
    """P pixels, changed in place: all but the first two.

    Attributes:
        pixel: [P].
        view_direction: [P, 3].
        coefficients: [P, 14].
        normal: [P, 3].
        surface_normal: [P, 3].
        blurred_normal: [P, 3].
        alpha_squared: [P].
        nail: [P].
        alpha: of all pixels of the image.
    """

    pixel: np.ndarray
    view_direction: np.ndarray
    coefficients: np.ndarray
    normal: np.ndarray
    surface_normal: np.ndarray
    blurred_normal: np.ndarray
    alpha_squared: np.ndarray
    nail: np.ndarray
    alpha: np.ndarray


@compiled
def add_skin(seen, surface, maps, ratio, constants, first, last, image):
    """Give pixels [first, last) of `image` (`DetailedArrays`) the coverage, normals, colours and nails of the skin."""
    rows, of_pixel = np.zeros((_ROWS, _BLOCK), np.float32), np.empty(_BLOCK, np.int64)
    values, blurred = np.empty((_BLOCK, TEXEL), np.float32), np.empty(TEXEL, np.float32)
    log_ratio = np.zeros(_COLOURED, np.float32)
    start = first
    while start < last:
        start, count = _gather(seen, surface, constants, image, start, last, rows, of_pixel)
        _place(rows, constants)
        for index in range(count):
            _read(maps, constants, rows, index, values[index], blurred)
        _bend(rows, constants)
        for index in range(count):
            if len(ratio.table) > 0:
                _read_ratio(ratio, constants, rows, index, log_ratio)
            _finish(image, constants, rows, index, of_pixel[index], values[index], log_ratio, seen.coverage)


@part
def _gather(seen, surface, constants, image, start, last, rows, of_pixel):
    """Fill the columns of pixels from `start` on that show the surface; all take its coverage.

    Returns where the next block starts, and the number of columns.
    """
    count = 0
    while start < last and count < _BLOCK:
        at, coefficients = image.pixel[start], image.coefficients[start]
        coverage, face = seen.coverage[at], seen.face[at]
        share = coverage / min(max(image.alpha[at], constants.least_alpha), _1)
        image.alpha[at] = coverage
        for k in range(len(coefficients)):
            coefficients[k] *= share
        _fill_specular(image.nail[start], coverage, coefficients)
        if face >= 0:
            for corner in range(3):
                vertex, row = surface.faces[face, corner], _CORNER * corner
                for k in range(3):
                    rows[row + k, count] = surface.vertices[vertex, k]
                    rows[row + _NORMAL + k, count] = surface.normals[vertex, k]
                for k in range(2):
                    rows[row + _UV + k, count] = surface.corner_uv[face, corner, k]
                rows[row + _FLEX, count] = surface.flex[vertex]
            for k in range(3):
                rows[_VIEW + k, count] = image.view_direction[start, k]
                x, y = np.float32(at % seen.width) + _HALF, np.float32(at // seen.width) + _HALF
                axes = seen.origin_axes
                rows[_ORIGIN + k, count] = x * axes[0, k] + y * axes[1, k] + axes[2, k]
            rows[_DEPTH, count] = seen.divisor[at]
            of_pixel[count] = start
            count += 1
        start += 1
    return start, count


@part
def _fill_specular(nail, coverage, coefficients):
    """Fill the coefficients of gloss, which is known: the tight lobe's on nails, the broad one's on skin."""
    coefficients[_GLOSS], coefficients[_GLOSS + 1] = nail * coverage, (_1 - nail) * coverage


@part
def _place(rows, constants):
    """Fill where in the maps the pixels look, and what is known of the surface there."""
    first_m = rows[_DEPTH, 0]
    first_level = np.log2(first_m * constants.texels) - constants.sharper
    for i in range(np.uintp(_BLOCK)):
        rows[_LEVEL, i] = first_level + octaves(first_m, rows[_DEPTH, i])
        ax, ay, az = rows[_A, i], rows[_A + 1, i], rows[_A + 2, i]
        eye_x, eye_y, eye_z = rows[_ORIGIN, i], rows[_ORIGIN + 1, i], rows[_ORIGIN + 2, i]
        bx, by, bz = rows[_B, i] - ax, rows[_B + 1, i] - ay, rows[_B + 2, i] - az
        cx, cy, cz = rows[_C, i] - ax, rows[_C + 1, i] - ay, rows[_C + 2, i] - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        squared = nx * nx + ny * ny + nz * nz
        inverse = _1 / max(squared, _TINY * _TINY)
        to_bx, to_by = (cy * nz - cz * ny) * inverse, (cz * nx - cx * nz) * inverse
        to_cx, to_cy = (ny * bz - nz * by) * inverse, (nz * bx - nx * bz) * inverse
        to_bz, to_cz = (cx * ny - cy * nx) * inverse, (nx * by - ny * bx) * inverse
        vx, vy, vz = rows[_VIEW, i], rows[_VIEW + 1, i], rows[_VIEW + 2, i]
        facing = vx * nx + vy * ny + vz * nz
        ahead = (ax - eye_x) * nx + (ay - eye_y) * ny + (az - eye_z) * nz
        distance = ahead / facing if facing != _0 else _0
        ox, oy, oz = eye_x + distance * vx - ax, eye_y + distance * vy - ay, eye_z + distance * vz - az
        wb, wc = ox * to_bx + oy * to_by + oz * to_bz, ox * to_cx + oy * to_cy + oz * to_cz
        wa = _1 - wb - wc
        length = max(np.sqrt(squared), _TINY)
        cosine = max(abs(facing) / length, constants.least_cosine)
        rows[_COSINE, i] = cosine
        ub, vb = rows[_B + _UV, i] - rows[_A + _UV, i], rows[_B + _UV + 1, i] - rows[_A + _UV + 1, i]
        uc, vc = rows[_C + _UV, i] - rows[_A + _UV, i], rows[_C + _UV + 1, i] - rows[_A + _UV + 1, i]
        rows[_U, i] = wa * rows[_A + _UV, i] + wb * rows[_B + _UV, i] + wc * rows[_C + _UV, i]
        rows[_V, i] = wa * rows[_A + _UV + 1, i] + wb * rows[_B + _UV + 1, i] + wc * rows[_C + _UV + 1, i]
        rows[_BENT, i] = wa * rows[_A + _FLEX, i] + wb * rows[_B + _FLEX, i] + wc * rows[_C + _FLEX, i]
        # The direction in which the face is tilted, along it.
        into = facing * inverse
        tilt = max(np.sqrt(max(_1 - into * into * squared, _0)), _TINY)
        tx, ty, tz = (vx - into * nx) / tilt, (vy - into * ny) / tilt, (vz - into * nz) / tilt
        along_b, along_c = tx * to_bx + ty * to_by + tz * to_bz, tx * to_cx + ty * to_cy + tz * to_cz
        step_m = rows[_DEPTH, i] * constants.texels * constants.texel_m / cosine
        rows[_STEP, i], rows[_STEP + 1, i] = (
            step_m * (along_b * ub + along_c * uc),
            step_m * (along_b * vb + along_c * vc),
        )
        rows[_UV_B, i], rows[_UV_B + 1, i], rows[_UV_C, i], rows[_UV_C + 1, i] = ub, vb, uc, vc
        rows[_ALONG_B, i], rows[_ALONG_B + 1, i], rows[_ALONG_B + 2, i] = to_bx, to_by, to_bz
        rows[_ALONG_C, i], rows[_ALONG_C + 1, i], rows[_ALONG_C + 2, i] = to_cx, to_cy, to_cz
        nx = wa * rows[_A + _NORMAL, i] + wb * rows[_B + _NORMAL, i] + wc * rows[_C + _NORMAL, i]
        ny = wa * rows[_A + _NORMAL + 1, i] + wb * rows[_B + _NORMAL + 1, i] + wc * rows[_C + _NORMAL + 1, i]
        nz = wa * rows[_A + _NORMAL + 2, i] + wb * rows[_B + _NORMAL + 2, i] + wc * rows[_C + _NORMAL + 2, i]
        inverse = _1 / max(np.sqrt(nx * nx + ny * ny + nz * nz), _TINY)
        rows[_SURFACE, i], rows[_SURFACE + 1, i], rows[_SURFACE + 2, i] = nx * inverse, ny * inverse, nz * inverse


@part
def _read(maps, constants, rows, index, values, blurred):
    """Fill a pixel's values [12] of the maps, and its columns of slopes."""
    u, v = rows[_U, index], rows[_V, index]
    level, taps = rows[_LEVEL, index], _taps(constants, rows, index)
    for k in range(TEXEL):
        values[k], blurred[k] = _0, _0
    share = _1 / np.float32(taps)
    for tap in range(taps):
        aside = (np.float32(tap) - _HALF * np.float32(taps - 1)) * share
        _add_sample(maps, u + aside * rows[_STEP, index], v + aside * rows[_STEP + 1, index], level, share, values)
    if level < constants.blurred_level:
        _add_sample(maps, u, v, constants.blurred_level, _1, blurred)
    for k in range(_SLOPES):
        rows[_SLOPES_AT + k, index] = values[k]
        rows[_BLURRED_AT + k, index] = blurred[k] if level < constants.blurred_level else values[k]


@part
def _taps(constants, rows, index):
    return min(int(_1 / rows[_COSINE, index] + constants.one_tap_more), constants.most_taps)


@part
def _read_ratio(ratio, constants, rows, index, log_ratio):
    """Fill the logarithm [3] of the person's factor on albedo, over the taps of `_read`."""
    level = min(max(rows[_LEVEL, index] + ratio.finer_by, _0), np.float32(len(ratio.first) - 1))
    fine, taps = int(level), _taps(constants, rows, index)
    between, share = level - np.float32(fine), _1 / np.float32(taps)
    for k in range(_COLOURED):
        log_ratio[k] = _0
    for tap in range(taps):
        aside = (np.float32(tap) - _HALF * np.float32(taps - 1)) * share
        u = rows[_U, index] + aside * rows[_STEP, index]
        v = rows[_V, index] + aside * rows[_STEP + 1, index]
        _add_ratio(ratio, u, v, fine, ratio.step * share * (_1 - between), log_ratio)
        if between > _0:
            _add_ratio(ratio, u, v, fine + 1, ratio.step * share * between, log_ratio)


@part
def _bend(rows, constants):
    """Fill the unit normals: that of the surface, bent by the slopes, sharp and blurred."""
    for to, slopes in ((_BUMPED, _SLOPES_AT), (_BLURRED, _BLURRED_AT)):
        for i in range(np.uintp(_BLOCK)):
            dorsal = max(_1 - constants.flattened * rows[_BENT, i], _0)
            palmar = constants.deepened_from + constants.deepened_by * rows[_BENT, i]
            along_u = rows[slopes, i] - dorsal * rows[slopes + 2, i] - palmar * rows[slopes + 4, i]
            along_v = rows[slopes + 1, i] - dorsal * rows[slopes + 3, i] - palmar * rows[slopes + 5, i]
            along_u, along_v = along_u * constants.bump, along_v * constants.bump
            to_b = along_u * rows[_UV_B, i] + along_v * rows[_UV_B + 1, i]
            to_c = along_u * rows[_UV_C, i] + along_v * rows[_UV_C + 1, i]
            x = rows[_SURFACE, i] + to_b * rows[_ALONG_B, i] + to_c * rows[_ALONG_C, i]
            y = rows[_SURFACE + 1, i] + to_b * rows[_ALONG_B + 1, i] + to_c * rows[_ALONG_C + 1, i]
            z = rows[_SURFACE + 2, i] + to_b * rows[_ALONG_B + 2, i] + to_c * rows[_ALONG_C + 2, i]
            inverse = _1 / max(np.sqrt(x * x + y * y + z * z), _TINY)
            rows[to, i], rows[to + 1, i], rows[to + 2, i] = x * inverse, y * inverse, z * inverse


@part
def _finish(image, constants, rows, index, pixel, values, log_ratio, coverage):
    """Write a pixel's normals, gloss, nail and colours."""
    for k in range(3):
        image.surface_normal[pixel, k] = rows[_SURFACE + k, index]
        image.normal[pixel, k] = rows[_BUMPED + k, index]
        image.blurred_normal[pixel, k] = rows[_BLURRED + k, index]
    dorsal = max(_1 - constants.flattened * rows[_BENT, index], _0)
    palmar = constants.deepened_from + constants.deepened_by * rows[_BENT, index]
    folds = dorsal * constants.bump_share
    squared = values[_SQUARED] + folds * folds * values[_HIDDEN_FOLDS]
    image.alpha_squared[pixel] = max(squared, _1) * constants.gloss
    nail, coefficients = values[_NAIL] * constants.shade, image.coefficients[pixel]
    image.nail[pixel] = nail
    _fill_specular(nail, coverage[image.pixel[pixel]], coefficients)
    folded = (dorsal * values[7] + palmar * values[8]) * constants.shade
    for k in range(3):
        pigment = values[_SLOPES] * constants.shade * constants.pigment_colour[k]
        factor = grown(pigment + log_ratio[k] + folded * constants.fold_log_albedo[k])
        for group in range(_COLOURED):
            coefficients[_COLOURS + 3 * group + k] *= factor


@part
def _add_sample(maps, u, v, level, weight, values):
    """Add the values at a point between two levels, in stored steps, times a weight."""
    level = min(max(level, _0), np.float32(len(maps.first) - 1))
    fine = int(level)
    share = level - np.float32(fine)
    _add_level(maps, u, v, fine, weight * (_1 - share), values)
    if share > _0:
        _add_level(maps, u, v, fine + 1, weight * share, values)


@part
def _add_level(maps, u, v, level, share, values):
    """Add one level's values, bilinear, times a share."""
    size = maps.resolution >> level
    texel, weights = _texels(u, v, size, share)
    add_texels(maps.table, maps.first[level] + texel, size, weights, values)


@part
def _add_ratio(ratio, u, v, level, share, log_ratio):
    """Add one level's logarithms, bilinear, times a share."""
    size = ratio.resolution >> level
    texel, (wa, wb, wc, wd) = _texels(u, v, size, share)
    table, at = ratio.table, ratio.first[level] + texel
    for k in range(_COLOURED):
        below = wa * np.float32(table[at, k]) + wb * np.float32(table[at + 1, k])
        above = wc * np.float32(table[at + size, k]) + wd * np.float32(table[at + size + 1, k])
        log_ratio[k] += below + above


@part
def _texels(u, v, size, share):
    """Find the first of four texels around a point, and their weights (itself, right, above, both), times a share."""
    x = min(max(u * np.float32(size) - _HALF, _0), np.float32(size - 1))
    y = min(max(v * np.float32(size) - _HALF, _0), np.float32(size - 1))
    column, row = min(int(x), size - 2), min(int(y), size - 2)
    right, above = x - np.float32(column), y - np.float32(row)
    wa, wb = share * (_1 - right) * (_1 - above), share * right * (_1 - above)
    wc, wd = share * (_1 - right) * above, share * right * above
    return row * size + column, (wa, wb, wc, wd)
