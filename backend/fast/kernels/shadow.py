"""Equals `geometry.visibility.lit_share_reference` and `geometry.shadow_maps.look_up_reference`: small shadow maps."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .raster import nearest_depth, nearest_sides
from .records import ProjectedMesh

_HALF, _0, _1, _NO_DEPTH = (np.float32(value) for value in (0.5, 0, 1, 1e-6))


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
    """Make the maps of views [first, last) and fill lit and depth_in [K, P] of the points [P, 3]."""
    size = casters.map_px
    entry, leaving = np.empty(size * size, np.float32), np.empty(size * size, np.float32)
    other = np.empty(size * size, np.float32)
    vertices = ProjectedMesh(
        np.empty((len(casters.vertices), 2), np.float32), np.empty(len(casters.vertices), np.float32), casters.faces
    )
    others = ProjectedMesh(
        np.empty((len(casters.others), 2), np.float32), np.empty(len(casters.others), np.float32), casters.others_faces
    )
    for view in range(first, last):
        entry[:], leaving[:], other[:] = np.inf, np.inf, np.inf
        _project(casters, view, casters.vertices, vertices)
        _project(casters, view, casters.others, others)
        nearest_sides(vertices.positions_px, vertices.depth, casters.faces, size, entry, leaving)
        nearest_depth(others, size, 0, size, True, other)
        _join(entry, leaving, other, casters.contact)
        for point in range(len(points)):
            x, y, depth = _projected(casters, view, points, point)
            lit[view, point], depth_in[view, point] = _look_up(entry, leaving, casters, x, y, depth)


@compiled
def _project(casters, view, places, mesh):
    """Fill the positions and depths of a mesh in a view."""
    for index in range(len(places)):
        x, y, depth = _projected(casters, view, places, index)
        mesh.positions_px[index, 0], mesh.positions_px[index, 1], mesh.depth[index] = x, y, depth


@compiled
def _projected(casters, view, places, index):
    """(x px, y px, depth) of a place in a view."""
    frames, px, py, pz = casters.frames, places[index, 0], places[index, 1], places[index, 2]
    x = frames[view, 0, 0] * px + frames[view, 0, 1] * py + frames[view, 0, 2] * pz
    y = frames[view, 1, 0] * px + frames[view, 1, 1] * py + frames[view, 1, 2] * pz
    z = frames[view, 2, 0] * px + frames[view, 2, 1] * py + frames[view, 2, 2] * pz
    distance, half = casters.distance[view], np.float32(casters.map_px) * _HALF
    depth = distance - z
    scale = casters.px_per_radius[view] * distance / (depth if abs(depth) > _NO_DEPTH else _NO_DEPTH)
    return x * scale + half, y * scale + half, depth


@compiled
def _join(entry, leaving, other, contact):
    """Turn `leaving` into the depth at which light ends; entry is minus infinity where it ends before the mesh."""
    for pixel in range(len(entry)):
        middle = _HALF * (entry[pixel] + leaving[pixel]) if leaving[pixel] < np.inf else entry[pixel]
        blocker = other[pixel] + contact
        if blocker < entry[pixel]:
            entry[pixel] = -np.inf
        leaving[pixel] = min(middle, blocker)


@compiled
def _look_up(entry, blocker, casters, x, y, depth):
    """(share of the four nearest pixels in which a point is lit, its depth behind the surface)."""
    size, most = casters.map_px, casters.max_depth_in
    x, y = x - _HALF, y - _HALF
    last = np.float32(size - 1)
    if not (x >= _0 and y >= _0 and x < last and y < last and depth > _0):
        return _1, _0
    column, row = int(x), int(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    lit, inside = _0, _0
    for dy in range(2):
        wy = fy if dy else _1 - fy
        for dx in range(2):
            weight = wy * (fx if dx else _1 - fx)
            pixel = (row + dy) * size + column + dx
            if depth <= blocker[pixel] + casters.tolerance:
                lit += weight
            inside += weight * min(max(depth - entry[pixel], -most), most)
    return lit, max(inside, _0)
