"""Equals `light.visibility.lit_share_reference` and `light.shadow_maps.look_up_reference`: small shadow maps."""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from ...geometry.tolerances import LEAST_SQUARED, LEAST_WINDOW, STEEPEST
from .compiled import compiled
from .compiled import compiled_part as part
from .raster import ProjectedMesh, nearest_depth, nearest_sides

_HALF, _0, _1, _NO_DEPTH = (np.float32(value) for value in (0.5, 0, 1, 1e-6))
_INF, _STEEPEST = np.float32(np.inf), np.float32(STEEPEST)
_LEAST_SQUARED, _LEAST_WINDOW = np.float32(LEAST_SQUARED), np.float32(LEAST_WINDOW)
_ROW, _NEXT = 256, np.uintp(1)

ShadowPoints = namedtuple("ShadowPoints", "px depth lifted_px lifted_depth bias")
"""As `light.visibility.ShadowMapPoints`."""


class ShadowCasters(NamedTuple):
    """As `light.shadow_maps.ShadowScene`; lengths are in radii.

    Attributes:
        frames: [K, 3, 3] of the views.
        distance: [K] of the light.
        vertices: [3, V] of the mesh.
        faces: [F, 3] of the mesh.
        others: [3, 3 T] corners of other triangles.
        others_faces: [T, 3] their indices.
        map_px: width and height of a map.
        tolerance: by which a point may lie behind the middle of the mesh.
        contact: by which it may lie behind another triangle.
        max_depth_in: largest depth behind the surface.
        template_m: template metres of a radius.
    """

    frames: np.ndarray
    distance: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    others: np.ndarray
    others_faces: np.ndarray
    map_px: int
    tolerance: np.float32
    contact: np.float32
    max_depth_in: np.float32
    template_m: np.float32


class _PointRows(NamedTuple):
    """What rows of points are computed in.

    Attributes:
        place: [3, N] x and y, px, and depth.
        bounds: [4, N] least x and y, largest x and y.
        at: [N] pixel.
        shares: [2, N] of the next pixel along x and y.
        read: [N, 8] what the map has in the four pixels around.
    """

    place: np.ndarray
    bounds: np.ndarray
    at: np.ndarray
    shares: np.ndarray
    read: np.ndarray


@compiled
def lit_share(points, faces, size, first, last, lit):
    """Rasterise the shadow maps of directions [first, last), `size` px wide, and fill lit [K, V] in [0, 1]."""
    shadow = np.empty(size * size, np.float32)
    for index in range(first, last):
        shadow[:] = np.inf
        mesh = ProjectedMesh(points.px[index], points.depth[index], faces, False)
        nearest_depth(mesh, size, 0, size, True, shadow)
        for vertex in range(lit.shape[1]):
            x, y = points.lifted_px[index, vertex, 0], points.lifted_px[index, vertex, 1]
            lit[index, vertex] = _unblocked(shadow, size, x, y, points.lifted_depth[index, vertex] - points.bias)


@part
def _unblocked(shadow, size, x, y, depth):
    """Compute the bilinear share of the four nearest map pixels that do not block a depth."""
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
    """Make the maps of views [first, last) around the points [3, P], and fill their lit and depth_in [K, P]."""
    size = casters.map_px
    entry, leaving = np.empty(size * size, np.float32), np.empty(size * size, np.float32)
    other = np.empty(size * size if len(casters.others) else 0, np.float32)
    way = np.empty((size * size, 2), np.float32)
    vertices, others = np.empty((3, casters.vertices.shape[1]), np.float32), np.empty_like(casters.others)
    cells, of_others = np.empty((4, vertices.shape[1]), np.int32), np.empty((4, others.shape[1]), np.int32)
    rows = _PointRows(
        np.empty((3, _ROW), np.float32),
        np.empty((4, _ROW), np.float32),
        np.empty(_ROW, np.uint32),
        np.empty((2, _ROW), np.float32),
        np.empty((_ROW, 8), np.float32),
    )
    for view in range(first, last):
        entry[:], leaving[:], other[:] = np.inf, np.inf, np.inf
        window = _window_around(casters, view, points, rows)
        _project(casters, view, window, casters.vertices, 0, casters.vertices.shape[1], vertices)
        nearest_sides(vertices, casters.faces, size, cells, entry, leaving)
        _end_in_the_middle(entry, leaving, _STEEPEST / min(window[2], window[3]), way)
        if len(other):
            _project(casters, view, window, casters.others, 0, casters.others.shape[1], others)
            nearest_sides(others, casters.others_faces, size, of_others, other, other)
            _end_at_others(other, casters.contact, way)
        _look_up(casters, view, window, points, way, rows, lit[view], depth_in[view])


@part
def _window_around(casters, view, points, rows):
    """Fit (x and y of the upper left corner, px, px per radius along x and y) as `MapWindows.around`."""
    distance, half = casters.distance[view], np.float32(casters.map_px) * _HALF
    reach = distance / np.sqrt(max(distance * distance - _1, _LEAST_SQUARED))
    if points.shape[1] == 0:
        scale = (half - _1) / reach
        return half, half, scale, scale
    place, bounds = rows.place, rows.bounds
    for index in range(_ROW):
        bounds[0, index], bounds[1, index], bounds[2, index], bounds[3, index] = _INF, _INF, -_INF, -_INF
    for start in range(0, points.shape[1], _ROW):
        count = min(_ROW, points.shape[1] - start)
        _project(casters, view, (_0, _0, _1, _1), points, start, start + count, place)
        for index in range(count):
            x, y = min(max(place[0, index], -reach), reach), min(max(place[1, index], -reach), reach)
            x, y = x if place[2, index] > _0 else _0, y if place[2, index] > _0 else _0
            bounds[0, index], bounds[1, index] = min(bounds[0, index], x), min(bounds[1, index], y)
            bounds[2, index], bounds[3, index] = max(bounds[2, index], x), max(bounds[3, index], y)
    x0, y0, x1, y1 = _INF, _INF, -_INF, -_INF
    for index in range(_ROW):
        x0, y0 = min(x0, bounds[0, index]), min(y0, bounds[1, index])
        x1, y1 = max(x1, bounds[2, index]), max(y1, bounds[3, index])
    scale_x = (half - _1) / max((x1 - x0) * _HALF, _LEAST_WINDOW)
    scale_y = (half - _1) / max((y1 - y0) * _HALF, _LEAST_WINDOW)
    return half - (x0 + x1) * _HALF * scale_x, half - (y0 + y1) * _HALF * scale_y, scale_x, scale_y


@part
def _project(casters, view, window, map_points, first, last, out):
    """Fill out [3, last - first] with x and y, px, and depths of points [3, P] from first to last in a view's window.

    A slice of the points would not do: its rows have a stride, and no vector instructions.
    """
    frame, distance = casters.frames[view], casters.distance[view]
    xx, xy, xz, yx, yy, yz = frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2]
    zx, zy, zz = frame[2, 0], frame[2, 1], frame[2, 2]
    left, top, scale_x, scale_y = window
    begin = np.uintp(first)
    for index in range(np.uintp(last - first)):
        px, py, pz = map_points[0, begin + index], map_points[1, begin + index], map_points[2, begin + index]
        depth = distance - (zx * px + zy * py + zz * pz)
        enlarged = distance / (depth if abs(depth) > _NO_DEPTH else _NO_DEPTH)
        out[0, index] = (xx * px + xy * py + xz * pz) * enlarged * scale_x + left
        out[1, index] = (yx * px + yy * py + yz * pz) * enlarged * scale_y + top
        out[2, index] = depth


@part
def _end_in_the_middle(entry, leaving, most, way):
    """Fill way [P, 2]: the depths at which light enters and ends, side by side, as they are read together.

    It ends `most` behind where it enters at the latest.
    """
    for pixel in range(len(entry)):
        way[pixel, 0] = entry[pixel]
        within = min(_HALF * (leaving[pixel] - entry[pixel]), most)
        way[pixel, 1] = entry[pixel] + within if leaving[pixel] < np.inf else entry[pixel]


@part
def _end_at_others(other, contact, way):
    """Let light end at other triangles too; it enters at minus infinity where that is before the mesh."""
    for pixel in range(len(other)):
        blocker = other[pixel] + contact
        way[pixel, 1] = min(way[pixel, 1], blocker)
        if blocker < way[pixel, 0]:
            way[pixel, 0] = -np.inf


@part
def _look_up(casters, view, window, points, way, rows, lit, depth_in):
    """Fill the share of the four nearest pixels in which points are lit, and their depth behind the surface.

    Points are taken in short rows without branches, which become vector instructions; only the reading of the map,
    which is slow in them, stands apart.
    """
    place, at, shares, read = rows.place, rows.at, rows.shares, rows.read
    size, tolerance, most = casters.map_px, casters.tolerance, casters.max_depth_in
    limit = np.float32(size - 1)
    for start in range(0, points.shape[1], _ROW):
        count = min(_ROW, points.shape[1] - start)
        _project(casters, view, window, points, start, start + count, place)
        for index in range(count):
            x, y = place[0, index] - _HALF, place[1, index] - _HALF
            is_inside = (x >= _0) & (y >= _0) & (x < limit) & (y < limit) & (place[2, index] > _0)
            x, y = x if is_inside else _0, y if is_inside else _0
            column, row = np.int32(x), np.int32(y)
            at[index] = row * np.int32(size) + column
            shares[0, index], shares[1, index] = x - np.float32(column), y - np.float32(row)
            place[0, index] = _0 if is_inside else _1
        for index in range(count):
            here, above = np.uintp(index), np.uintp(at[index])
            below = above + np.uintp(size)
            # All are read before any is written, so that two neighbours become one vector.
            a, b, c, d = way[above, 0], way[above, 1], way[above + _NEXT, 0], way[above + _NEXT, 1]
            e, f, g, h = way[below, 0], way[below, 1], way[below + _NEXT, 0], way[below + _NEXT, 1]
            read[here, 0], read[here, 1], read[here, 2], read[here, 3] = a, b, c, d
            read[here, 4], read[here, 5], read[here, 6], read[here, 7] = e, f, g, h
        for index in range(count):
            here, depth, fx, fy = np.uintp(index), place[2, index], shares[0, index], shares[1, index]
            wa, wb, wc, wd = (_1 - fx) * (_1 - fy), fx * (_1 - fy), (_1 - fx) * fy, fx * fy
            nearer = depth - tolerance
            share = wa if nearer <= read[here, 1] else _0
            share += wb if nearer <= read[here, 3] else _0
            share += wc if nearer <= read[here, 5] else _0
            share += wd if nearer <= read[here, 7] else _0
            ea, eb, ec, ed = read[here, 0], read[here, 2], read[here, 4], read[here, 6]
            inside = wa * min(max(depth - ea, -most), most) if ea < _INF else _0
            inside += wb * min(max(depth - eb, -most), most) if eb < _INF else _0
            inside += wc * min(max(depth - ec, -most), most) if ec < _INF else _0
            inside += wd * min(max(depth - ed, -most), most) if ed < _INF else _0
            is_outside = place[0, index] > _0
            lit[start + index] = _1 if is_outside else share
            depth_in[start + index] = _0 if is_outside else max(inside, _0) * casters.template_m
