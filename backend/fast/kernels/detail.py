"""Equals `nerf.skin_detail.detailed_image`, where `raster.nearest_faces` tells which face each pixel sees."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

_0, _HALF, _1, _TINY = (np.float32(value) for value in (0, 0.5, 1, 1e-12))
_CHANNELS, _SLOPES, _NAIL = 10, 6, 9
_COLOURS = 3  # where the coefficients of colours begin, RGB three times
_COLOURED = 3
PLACE_STEPS = 2
"""As in `nerf.skin_detail`."""
_GLOSS = 12  # where that of both lobes begins


@compiled
def add_detail(seen, mesh, skin, maps, constants, first, last, image):
    """Bend the normals of pixels [first, last) of `image` (`DetailedArrays`), darken colours, and polish nails."""
    corner, weights, values = np.empty(4, np.int64), np.empty(3, np.float32), np.empty(_CHANNELS, np.float32)
    place, off = np.empty(2, np.float32), np.empty(3, np.float32)
    for index in range(first, last):
        face = seen.face[image.pixel[index]]
        if face < 0:
            continue
        depth = seen.depth[image.pixel[index]]
        _weigh(image.pixel[index] % seen.width, image.pixel[index] // seen.width, mesh, face, weights)
        u, v, flex = _0, _0, _0
        for k in range(3):
            u += weights[k] * skin.corner_uv[face, k, 0]
            v += weights[k] * skin.corner_uv[face, k, 1]
            flex += weights[k] * skin.flex[mesh.faces[face, k]]
        normal, view = image.normal[index], image.view_direction[index]
        place[0], place[1] = u, v
        cosine = max(_face_cosine(skin.gradients, face, view), constants.least_cosine)
        _move(skin.gradients, face, view, constants.scale / cosine, maps.offset, off, place)
        texels = depth * constants.texels / cosine
        _sample(maps, place[0], place[1], np.log2(texels), corner, values)
        dorsal = max(constants.straight - constants.flattened * flex, _0)
        palmar = constants.deepened_from + constants.deepened_by * flex
        along_u = (values[0] - dorsal * values[2] - palmar * values[4]) * constants.bump
        along_v = (values[1] - dorsal * values[3] - palmar * values[5]) * constants.bump
        squared = _TINY
        for k in range(3):
            normal[k] += along_u * skin.gradients[face, 0, k] + along_v * skin.gradients[face, 1, k]
            squared += normal[k] * normal[k]
        length = np.sqrt(squared)
        nail = values[_NAIL] * constants.nail
        image.nail[index] = nail
        image.coefficients[index, _GLOSS] += nail * image.coefficients[index, _GLOSS + 1]
        image.coefficients[index, _GLOSS + 1] *= _1 - nail
        folded = (dorsal * values[7] + palmar * values[8]) * constants.shade
        for k in range(3):
            normal[k] /= length
            factor = np.exp(values[_SLOPES] * constants.shade + folded * constants.fold_log_albedo[k])
            for group in range(_COLOURED):
                image.coefficients[index, _COLOURS + 3 * group + k] *= factor


@compiled
def _face_cosine(gradients, face, view):
    """Of a face's normal and the view."""
    x = gradients[face, 0, 1] * gradients[face, 1, 2] - gradients[face, 0, 2] * gradients[face, 1, 1]
    y = gradients[face, 0, 2] * gradients[face, 1, 0] - gradients[face, 0, 0] * gradients[face, 1, 2]
    z = gradients[face, 0, 0] * gradients[face, 1, 1] - gradients[face, 0, 1] * gradients[face, 1, 0]
    return abs(x * view[0] + y * view[1] + z * view[2]) / max(np.sqrt(x * x + y * y + z * z), _TINY)


@compiled
def _move(gradients, face, view, per_height, offset, off, place):
    """Move a place of a flat face to that of the skin which is seen there, as `nerf.skin_detail.places_of_skin`."""
    along_u, along_v = _0, _0
    for k in range(3):
        along_u += gradients[face, 0, k] * view[k]
        along_v += gradients[face, 1, k] * view[k]
    along_u *= per_height
    along_v *= per_height
    u, v = place[0], place[1]
    for _ in range(PLACE_STEPS):
        _read_offset(offset, place, off)
        place[0], place[1] = u - off[2] * along_u - off[0], v - off[2] * along_v - off[1]


@compiled
def _read_offset(offset, place, off):
    """Fill the offset at a place, bilinear."""
    size = len(offset)
    x = min(max(place[0] * np.float32(size) - _HALF, _0), np.float32(size - 1))
    y = min(max(place[1] * np.float32(size) - _HALF, _0), np.float32(size - 1))
    column, row = min(int(x), size - 2), min(int(y), size - 2)
    right, above = x - np.float32(column), y - np.float32(row)
    for k in range(3):
        low = offset[row, column, k] * (_1 - right) + offset[row, column + 1, k] * right
        high = offset[row + 1, column, k] * (_1 - right) + offset[row + 1, column + 1, k] * right
        off[k] = low * (_1 - above) + high * above


@compiled
def _weigh(x, y, mesh, face, weights):
    """Fill the barycentric coordinates, in space, of a face's point at a pixel's centre."""
    a, b, c = mesh.faces[face, 0], mesh.faces[face, 1], mesh.faces[face, 2]
    px, py = np.float32(x) + _HALF, np.float32(y) + _HALF
    ax, ay = mesh.positions_px[a, 0], mesh.positions_px[a, 1]
    bx, by = mesh.positions_px[b, 0], mesh.positions_px[b, 1]
    cx, cy = mesh.positions_px[c, 0], mesh.positions_px[c, 1]
    weights[0] = ((cx - bx) * (py - by) - (cy - by) * (px - bx)) / mesh.depth[a]
    weights[1] = ((ax - cx) * (py - cy) - (ay - cy) * (px - cx)) / mesh.depth[b]
    weights[2] = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / mesh.depth[c]
    total = weights[0] + weights[1] + weights[2]
    for k in range(3):
        weights[k] /= total


@compiled
def _sample(maps, u, v, level, corner, values):
    """Fill the values at a place between two levels, in stored steps."""
    level = min(max(level, _0), np.float32(len(maps.first) - 1))
    fine = int(level)
    share = level - np.float32(fine)
    values[:] = _0
    _add_level(maps, u, v, fine, _1 - share, corner, values)
    if share > _0:
        _add_level(maps, u, v, fine + 1, share, corner, values)


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
