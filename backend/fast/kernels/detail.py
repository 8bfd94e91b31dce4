"""Equals `nerf.skin_detail.detailed_image`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

_0, _HALF, _1, _TINY = (np.float32(value) for value in (0, 0.5, 1, 1e-12))
_CHANNELS, _SLOPES, _NAIL, _SQUARED, _HIDDEN_FOLDS = 12, 6, 9, 10, 11
_COLOURS = 3  # where the coefficients of colours begin, RGB three times
_COLOURED = 3
_GLOSS = 12  # where that of both lobes begins
_AB, _AC, _NORMAL, _ALONG_B, _ALONG_C = 0, 1, 2, 3, 4  # rows of a face's shape
_SHAPE = 5


@compiled
def add_skin(seen, surface, maps, constants, first, last, image):
    """Give pixels [first, last) of `image` (`DetailedArrays`) the coverage, normals, colours and nails of the skin."""
    corner, step = np.empty(4, np.int64), np.empty(2, np.float32)
    values, blurred = np.empty(_CHANNELS, np.float32), np.empty(_CHANNELS, np.float32)
    shape, weights = np.empty((_SHAPE, 3), np.float32), np.empty(3, np.float32)
    for index in range(first, last):
        at = image.pixel[index]
        coverage, coefficients = seen.coverage[at], image.coefficients[index]
        share = coverage / min(max(image.alpha[at], constants.least_alpha), _1)
        image.alpha[at] = coverage
        for k in range(len(coefficients)):
            coefficients[k] *= share
        _fill_gloss(image.nail[index], coverage, coefficients)
        face = seen.face[at]
        if face < 0:
            continue
        view = image.view_direction[index]
        _describe(surface, face, shape)
        cosine = _locate(surface, face, shape, seen.camera, view, weights)
        u, v, flex = _0, _0, _0
        for k in range(3):
            u += weights[k] * surface.corner_uv[face, k, 0]
            v += weights[k] * surface.corner_uv[face, k, 1]
            flex += weights[k] * surface.flex[surface.faces[face, k]]
        cosine = max(cosine, constants.least_cosine)
        taps = min(int(_1 / cosine + constants.one_tap_more), constants.most_taps)
        texels = seen.depth[at] * constants.texels
        level = np.log2(texels) - constants.sharper
        values[:], step[:] = _0, _0
        if taps > 1:
            _step_along(surface, face, shape, view, texels * constants.texel_m / (cosine * np.float32(taps)), step)
        for tap in range(taps):
            aside = np.float32(tap) - _HALF * np.float32(taps - 1)
            _add_sample(maps, u + aside * step[0], v + aside * step[1], level, _1 / np.float32(taps), corner, values)
        dorsal = max(_1 - constants.flattened * flex, _0)
        palmar = constants.deepened_from + constants.deepened_by * flex
        _fill_normal(surface, face, weights, image.surface_normal[index])
        _bend(
            surface,
            face,
            shape,
            values,
            dorsal,
            palmar,
            constants.bump,
            image.surface_normal[index],
            image.normal[index],
        )
        if level < constants.blurred_level:
            blurred[:] = _0
            _add_sample(maps, u, v, constants.blurred_level, _1, corner, blurred)
        else:
            blurred[:] = values
        _bend(
            surface,
            face,
            shape,
            blurred,
            dorsal,
            palmar,
            constants.bump,
            image.surface_normal[index],
            image.blurred_normal[index],
        )
        folds = dorsal * constants.bump_share
        image.alpha_squared[index] = max(values[_SQUARED] + folds * folds * values[_HIDDEN_FOLDS], _1) * constants.gloss
        nail = values[_NAIL] * constants.shade
        image.nail[index] = nail
        _fill_gloss(nail, coverage, coefficients)
        folded = (dorsal * values[7] + palmar * values[8]) * constants.shade
        for k in range(3):
            pigment = values[_SLOPES] * constants.shade * constants.pigment_colour[k]
            factor = np.exp(pigment + folded * constants.fold_log_albedo[k])
            for group in range(_COLOURED):
                coefficients[_COLOURS + 3 * group + k] *= factor


@compiled
def _fill_gloss(nail, coverage, coefficients):
    """Fill the coefficients of gloss, which is known: the tight lobe's on nails, the broad one's on skin."""
    coefficients[_GLOSS], coefficients[_GLOSS + 1] = nail * coverage, (_1 - nail) * coverage


@compiled
def _describe(surface, face, shape):
    """Fill both sides of a face from its first corner, its normal, and the gradients of the other corners' shares."""
    a, b, c = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    for k in range(3):
        shape[_AB, k] = surface.vertices[b, k] - surface.vertices[a, k]
        shape[_AC, k] = surface.vertices[c, k] - surface.vertices[a, k]
    _cross(shape[_AB], shape[_AC], shape[_NORMAL])
    squared = max(_dot(shape[_NORMAL], shape[_NORMAL]), _TINY * _TINY)
    _cross(shape[_AC], shape[_NORMAL], shape[_ALONG_B])
    _cross(shape[_NORMAL], shape[_AB], shape[_ALONG_C])
    for k in range(3):
        shape[_ALONG_B, k] /= squared
        shape[_ALONG_C, k] /= squared


@compiled
def _locate(surface, face, shape, camera, view, weights):
    """Fill the barycentric coordinates of the point that is seen there; returns the cosine of view and face."""
    corner, normal = surface.vertices[surface.faces[face, 0]], shape[_NORMAL]
    facing, ahead = _dot(view, normal), _0
    for k in range(3):
        ahead += (corner[k] - camera[k]) * normal[k]
    distance = ahead / facing if facing != _0 else _0
    weights[1], weights[2] = _0, _0
    for k in range(3):
        off = camera[k] + distance * view[k] - corner[k]
        weights[1] += off * shape[_ALONG_B, k]
        weights[2] += off * shape[_ALONG_C, k]
    weights[0] = _1 - weights[1] - weights[2]
    return abs(facing) / max(np.sqrt(_dot(normal, normal)), _TINY)


@compiled
def _step_along(surface, face, shape, view, step_m, step):
    """Fill what a step along a face, in the direction in which it is tilted, is in u and v."""
    uv, normal = surface.corner_uv[face], shape[_NORMAL]
    squared = max(_dot(normal, normal), _TINY * _TINY)
    facing = _dot(view, normal) / squared
    length = max(np.sqrt(max(_1 - facing * facing * squared, _0)), _TINY)
    to_b, to_c = _0, _0
    for k in range(3):
        tilt = (view[k] - facing * normal[k]) / length
        to_b += tilt * shape[_ALONG_B, k]
        to_c += tilt * shape[_ALONG_C, k]
    for k in range(2):
        step[k] = step_m * (to_b * (uv[1, k] - uv[0, k]) + to_c * (uv[2, k] - uv[0, k]))


@compiled
def _fill_normal(surface, face, weights, normal):
    """Fill the unit normal at a point of a face."""
    corners = surface.faces[face]
    for k in range(3):
        normal[k] = _0
        for corner in range(3):
            normal[k] += weights[corner] * surface.normals[corners[corner], k]
    _normalise(normal)


@compiled
def _bend(surface, face, shape, values, dorsal, palmar, bump, surface_normal, normal):
    """Fill a unit normal: that of the surface, bent by the slopes among these values of the maps."""
    uv = surface.corner_uv[face]
    along_u = (values[0] - dorsal * values[2] - palmar * values[4]) * bump
    along_v = (values[1] - dorsal * values[3] - palmar * values[5]) * bump
    to_b = along_u * (uv[1, 0] - uv[0, 0]) + along_v * (uv[1, 1] - uv[0, 1])
    to_c = along_u * (uv[2, 0] - uv[0, 0]) + along_v * (uv[2, 1] - uv[0, 1])
    for k in range(3):
        normal[k] = surface_normal[k] + to_b * shape[_ALONG_B, k] + to_c * shape[_ALONG_C, k]
    _normalise(normal)


@compiled
def _normalise(vector):
    length = max(np.sqrt(_dot(vector, vector)), _TINY)
    for k in range(3):
        vector[k] /= length


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def _add_sample(maps, u, v, level, weight, corner, values):
    """Add the values at a place between two levels, in stored steps, times a weight."""
    level = min(max(level, _0), np.float32(len(maps.first) - 1))
    fine = int(level)
    share = level - np.float32(fine)
    _add_level(maps, u, v, fine, weight * (_1 - share), corner, values)
    if share > _0:
        _add_level(maps, u, v, fine + 1, weight * share, corner, values)


@compiled
def _add_level(maps, u, v, level, share, corner, values):
    """Add one level's values, bilinear, times a share."""
    size = maps.resolution >> level
    x = min(max(u * np.float32(size) - _HALF, _0), np.float32(size - 1))
    y = min(max(v * np.float32(size) - _HALF, _0), np.float32(size - 1))
    column, row = min(int(x), size - 2), min(int(y), size - 2)
    right, above = x - np.float32(column), y - np.float32(row)
    corner[0] = maps.first[level] + row * size + column
    corner[1], corner[2], corner[3] = corner[0] + 1, corner[0] + size, corner[0] + size + 1
    wa, wb = share * (_1 - right) * (_1 - above), share * right * (_1 - above)
    wc, wd = share * (_1 - right) * above, share * right * above
    a, b, c, d = maps.table[corner[0]], maps.table[corner[1]], maps.table[corner[2]], maps.table[corner[3]]
    for k in range(_CHANNELS):
        values[k] += wa * np.float32(a[k]) + wb * np.float32(b[k]) + wc * np.float32(c[k]) + wd * np.float32(d[k])
