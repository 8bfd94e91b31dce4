"""Equals `geometry.visibility.lit_share_reference` and `geometry.shadow_maps.look_up_reference`: small shadow maps."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .raster import nearest_depth, nearest_sides
from .records import ProjectedMesh

_HALF, _0, _1, _NO_DEPTH = (np.float32(value) for value in (0.5, 0, 1, 1e-6))
_INF = np.float32(np.inf)
_ROW, _NEXT = 256, np.uintp(1)


@compiled
def lit_share(points, faces, size, first, last, lit):
    """Rasterise the shadow maps of directions [first, last), `size` px wide, and fill lit [K, V] in [0, 1]."""
    shadow = np.empty(size * size, np.float32)
    for index in range(first, last):
        shadow[:] = np.inf
        mesh = ProjectedMesh(points.px[index], points.depth[index], faces)
        nearest_depth(mesh, size, 0, size, True, shadow)
        for vertex in range(lit.shape[1]):
            x, y = points.lifted_px[index, vertex, 0], points.lifted_px[index, vertex, 1]
            lit[index, vertex] = _unblocked(shadow, size, x, y, points.lifted_depth[index, vertex] - points.bias)


@compiled
def _unblocked(shadow, size, x, y, depth):
    """Bilinear share of the four nearest map pixels that do not block a depth."""
    limit = np.float32(size) - np.float32(1.001)
    x, y = min(max(x - _HALF, _0), limit), min(max(y - _HALF, _0), limit)
    column, row = int(x), int(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    pixel = row * size + column
    lit = _0
    if depth <= shadow[pixel]:
        lit += (_1 - fx) * (_1 - fy)
    if depth <= shadow[pixel + 1]:
        lit += fx * (_1 - fy)
    if depth <= shadow[pixel + size]:
        lit += (_1 - fx) * fy
    if depth <= shadow[pixel + size + 1]:
        lit += fx * fy
    return lit


@compiled
def look_up_points(casters, points, first, last, lit, depth_in):
    """Make the maps of views [first, last) and fill lit and depth_in [K, P] of the points [3, P]."""
    size = casters.map_px
    entry, leaving = np.empty(size * size, np.float32), np.empty(size * size, np.float32)
    other = np.empty(size * size if len(casters.others) else 0, np.float32)
    vertices, others = np.empty((3, casters.vertices.shape[1]), np.float32), np.empty_like(casters.others)
    for view in range(first, last):
        entry[:], leaving[:], other[:] = np.inf, np.inf, np.inf
        _project(casters, view, casters.vertices, vertices)
        nearest_sides(vertices, casters.faces, size, entry, leaving)
        _end_in_the_middle(entry, leaving)
        if len(other):
            _project(casters, view, casters.others, others)
            nearest_sides(others, casters.others_faces, size, other, other)
            _end_at_others(entry, leaving, other, casters.contact)
        _look_up(casters, view, points, entry, leaving, lit[view], depth_in[view])


@compiled
def _project(casters, view, places, out):
    """Fill out [3, P] with the x and y, px, and depths of places [3, P] in a view."""
    frame, distance = casters.frames[view], casters.distance[view]
    xx, xy, xz, yx, yy, yz = frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2]
    zx, zy, zz = frame[2, 0], frame[2, 1], frame[2, 2]
    centre, half = casters.window_centre[view], np.float32(casters.map_px) * _HALF
    scale_x, scale_y = casters.px_per_radius[view, 0], casters.px_per_radius[view, 1]
    left, top = half - centre[0] * scale_x, half - centre[1] * scale_y
    for index in range(places.shape[1]):
        px, py, pz = places[0, index], places[1, index], places[2, index]
        depth = distance - (zx * px + zy * py + zz * pz)
        enlarged = distance / (depth if abs(depth) > _NO_DEPTH else _NO_DEPTH)
        out[0, index] = (xx * px + xy * py + xz * pz) * enlarged * scale_x + left
        out[1, index] = (yx * px + yy * py + yz * pz) * enlarged * scale_y + top
        out[2, index] = depth


@compiled
def _end_in_the_middle(entry, leaving):
    """Turn `leaving` into the depth at which light ends."""
    for pixel in range(len(entry)):
        leaving[pixel] = _HALF * (entry[pixel] + leaving[pixel]) if leaving[pixel] < np.inf else entry[pixel]


@compiled
def _end_at_others(entry, end, other, contact):
    """Let light end at other triangles too; entry is minus infinity where that is before the mesh."""
    for pixel in range(len(entry)):
        blocker = other[pixel] + contact
        end[pixel] = min(end[pixel], blocker)
        if blocker < entry[pixel]:
            entry[pixel] = -np.inf


@compiled
def _look_up(casters, view, points, entry, end, lit, depth_in):
    """Fill the share of the four nearest pixels in which points are lit, and their depth behind the surface.

    Points are taken in short rows without branches, which become vector instructions.
    """
    place, at, shares = np.empty((3, _ROW), np.float32), np.empty(_ROW, np.uint32), np.empty((2, _ROW), np.float32)
    size, tolerance, most = casters.map_px, casters.tolerance, casters.max_depth_in
    limit = np.float32(size - 1)
    for start in range(0, points.shape[1], _ROW):
        count = min(_ROW, points.shape[1] - start)
        _project(casters, view, points[:, start : start + count], place)
        for index in range(count):
            x, y = place[0, index] - _HALF, place[1, index] - _HALF
            is_inside = (x >= _0) & (y >= _0) & (x < limit) & (y < limit) & (place[2, index] > _0)
            x, y = x if is_inside else _0, y if is_inside else _0
            column, row = np.int32(x), np.int32(y)
            at[index] = row * np.int32(size) + column
            shares[0, index], shares[1, index] = x - np.float32(column), y - np.float32(row)
            place[0, index] = _0 if is_inside else _1
        for index in range(count):
            depth, pixel, fx, fy = place[2, index], np.uintp(at[index]), shares[0, index], shares[1, index]
            below = pixel + np.uintp(size)
            wa, wb, wc, wd = (_1 - fx) * (_1 - fy), fx * (_1 - fy), (_1 - fx) * fy, fx * fy
            nearer = depth - tolerance
            share = wa if nearer <= end[pixel] else _0
            share += wb if nearer <= end[pixel + _NEXT] else _0
            share += wc if nearer <= end[below] else _0
            share += wd if nearer <= end[below + _NEXT] else _0
            ea, eb, ec, ed = entry[pixel], entry[pixel + _NEXT], entry[below], entry[below + _NEXT]
            inside = wa * min(max(depth - ea, -most), most) if ea < _INF else _0
            inside += wb * min(max(depth - eb, -most), most) if eb < _INF else _0
            inside += wc * min(max(depth - ec, -most), most) if ec < _INF else _0
            inside += wd * min(max(depth - ed, -most), most) if ed < _INF else _0
            is_outside = place[0, index] > _0
            lit[start + index] = _1 if is_outside else share
            depth_in[start + index] = _0 if is_outside else max(inside, _0)
