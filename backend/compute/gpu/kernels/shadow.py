"""Small shadow maps: as `light.shadow_maps.look_up_reference` and `light.visibility.lit_share_reference`.

Maps hold depths as the bits of positive floats, which have the order of their values. A table [K, 10] of whole
numbers says of each of K views which map it has, which of all points, vertices and faces are its own, and about which
sphere: so all shadows of a frame are one sequence, whatever they are cast on and by.
"""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....geometry.tolerances import LEAST_SQUARED, LEAST_WINDOW, NEAR_M, STEEPEST
from .compiled import INFINITE_BITS, Floats, Floats2, Ints, Ints2, Longs2, Matrices, Vectors, Vectors2, kernel, part
from .raster import covered_centres, fragment_depth, projected_area

wp.set_module_options({"fuse_fp": False})  # strict: which of two faces is the nearer hangs on the last bit
_LEAST_SQUARED, _LEAST_WINDOW = wp.constant(LEAST_SQUARED), wp.constant(LEAST_WINDOW)
_STEEPEST, _NEAR_M = wp.constant(float(STEEPEST)), wp.constant(NEAR_M)
_NO_DEPTH = wp.constant(1e-6)
_INFINITE = wp.constant(INFINITE_BITS)
_SIGN = wp.constant(0x7FFFFFFF)
FRONTS, BACKS, OTHERS = (wp.constant(value) for value in range(3))
"""Layers of a map: where light enters the mesh, where it leaves it, and the first of other triangles."""
MAP_PX, MAP_AT, FIRST_POINT, POINTS, POINTS_PER_RAY, FIRST_VERTEX, VERTICES, FIRST_FACE, FACES, SPHERE = (
    wp.constant(value) for value in range(10)
)
"""Columns of the table of views: side and place of the map; its points, and more of them for each ray; casters; and
which of the spheres and lengths are its own."""


@part
@no_type_check
def in_radii(point: wp.vec3, spheres: Floats2, table: Ints2, view: int) -> wp.vec3:
    """Give a point in radii from the centre of a view's sphere; `spheres` [N, 4]: centre and radius, m."""
    of = table[view, SPHERE]
    return (point - wp.vec3(spheres[of, 0], spheres[of, 1], spheres[of, 2])) / spheres[of, 3]


@part
@no_type_check
def points_of(table: Ints2, view: int, rays: int) -> int:
    """Compute how many points a view has."""
    points = int(table[view, POINTS])
    if table[view, POINTS_PER_RAY] > 0:
        points += rays
    return points


@part
@no_type_check
def _in_order(value: float) -> wp.int32:
    """Return an integer that is as much larger or smaller than others as its float is."""
    bits = wp.cast(value, wp.int32)
    if bits < 0:
        bits = bits ^ _SIGN
    return bits


@part
@no_type_check
def _of_order(bits: wp.int32) -> float:
    plain = int(bits)
    if plain < 0:
        plain = plain ^ _SIGN
    return wp.cast(plain, wp.float32)


@part
@no_type_check
def across(frame: wp.mat33, distance: float, point: wp.vec3) -> wp.vec3:
    """Find where the ray through a point crosses the plane of the centre, and the point's depth; in radii."""
    local = frame * point
    depth = distance - local[2]
    divisor = depth
    if wp.abs(depth) <= _NO_DEPTH:
        divisor = _NO_DEPTH
    enlarged = distance / divisor
    return wp.vec3(local[0] * enlarged, local[1] * enlarged, depth)


@kernel
@no_type_check
def find_bounds(
    count: Ints,
    spheres: Floats2,
    frames: Matrices,
    distance: Floats,
    table: Ints2,
    points: Vectors,
    parts: int,
    bounds: Ints2,
):
    """Widen bounds [K, 4] by every point, `parts` at once: least x and y, and of -x and -y, as `_in_order` has them."""
    view, first = wp.tid()
    total = points_of(table, view, count[0])
    if first >= total:
        return
    away = distance[view]
    reach = away / wp.sqrt(wp.max(away * away - 1.0, _LEAST_SQUARED))
    x0 = wp.float32(3.0e38)
    y0 = wp.float32(3.0e38)
    x1 = wp.float32(-3.0e38)
    y1 = wp.float32(-3.0e38)
    index = int(first)
    while index < total:
        place = across(frames[view], away, in_radii(points[table[view, FIRST_POINT] + index], spheres, table, view))
        x = wp.clamp(place[0], -reach, reach)
        y = wp.clamp(place[1], -reach, reach)
        if place[2] <= 0.0:
            x = wp.float32(0.0)
            y = wp.float32(0.0)
        x0 = wp.min(x0, x)
        y0 = wp.min(y0, y)
        x1 = wp.max(x1, x)
        y1 = wp.max(y1, y)
        index += parts
    wp.atomic_min(bounds, view, 0, _in_order(x0))
    wp.atomic_min(bounds, view, 1, _in_order(y0))
    wp.atomic_min(bounds, view, 2, _in_order(-x1))
    wp.atomic_min(bounds, view, 3, _in_order(-y1))


@part
@no_type_check
def window_of(distance: float, bounds: Ints2, view: int, points: int, map_px: int) -> wp.vec4:
    """Fit a window as `MapWindows.around`: x and y of its upper left corner, px, and px per radius."""
    half = float(map_px) * 0.5
    window = wp.vec4()
    if points == 0:
        scale = (half - 1.0) * wp.sqrt(wp.max(distance * distance - 1.0, _LEAST_SQUARED)) / distance
        window = wp.vec4(half, half, scale, scale)
    else:
        for axis in range(2):
            least = _of_order(bounds[view, axis])
            most = -_of_order(bounds[view, axis + 2])
            scale = (half - 1.0) / wp.max((most - least) * 0.5, _LEAST_WINDOW)
            window[axis] = half - (least + most) * 0.5 * scale
            window[axis + 2] = scale
    return window


@part
@no_type_check
def _in_window(frame: wp.mat33, distance: float, window: wp.vec4, point: wp.vec3) -> wp.vec3:
    place = across(frame, distance, point)
    return wp.vec3(place[0] * window[2] + window[0], place[1] * window[3] + window[1], place[2])


@kernel
@no_type_check
def project_casters(
    count: Ints,
    spheres: Floats2,
    frames: Matrices,
    distance: Floats,
    table: Ints2,
    bounds: Ints2,
    vertices: Vectors,
    placed: Vectors2,
):
    """Fill the places [K, V] of vertices in the maps: x and y, px, and depth, radii."""
    view, index = wp.tid()
    if index >= table[view, VERTICES]:
        return
    window = window_of(distance[view], bounds, view, points_of(table, view, count[0]), table[view, MAP_PX])
    at = table[view, FIRST_VERTEX] + index
    placed[view, at] = _in_window(frames[view], distance[view], window, in_radii(vertices[at], spheres, table, view))


@kernel
@no_type_check
def draw_sides(table: Ints2, placed: Vectors2, faces: Longs2, maps: Ints):
    """Lower the layers of maps to the mesh's front and back faces."""
    view, index = wp.tid()
    if index >= table[view, FACES]:
        return
    face = table[view, FIRST_FACE] + index
    a = placed[view, int(faces[face, 0])]
    b = placed[view, int(faces[face, 1])]
    c = placed[view, int(faces[face, 2])]
    area = projected_area(a, b, c)
    layer = int(BACKS)
    if area < 0.0:
        layer = int(FRONTS)
    if area != 0.0:
        _draw(a, b, c, area, table, maps, view, layer, 0, 1)


@kernel
@no_type_check
def draw_occluders(
    count: Ints,
    spheres: Floats2,
    frames: Matrices,
    distance: Floats,
    table: Ints2,
    bounds: Ints2,
    corners: Vectors,
    triangles: Ints,
    lanes: int,
    maps: Ints,
):
    """Lower the last layer of maps to either side of triangles, of which `corners` has three each, world, m.

    `triangles` [1] is their number, and `lanes` how many threads share the pixels of one.
    """
    view, triangle, lane = wp.tid()
    if triangle >= triangles[0]:
        return
    window = window_of(distance[view], bounds, view, points_of(table, view, count[0]), table[view, MAP_PX])
    a = _caster(corners[3 * triangle], spheres, frames, distance, table, window, view)
    b = _caster(corners[3 * triangle + 1], spheres, frames, distance, table, window, view)
    c = _caster(corners[3 * triangle + 2], spheres, frames, distance, table, window, view)
    area = projected_area(a, b, c)
    if area != 0.0:
        _draw(a, b, c, area, table, maps, view, OTHERS, lane, lanes)


@part
@no_type_check
def _caster(
    corner: wp.vec3,
    spheres: Floats2,
    frames: Matrices,
    distance: Floats,
    table: Ints2,
    window: wp.vec4,
    view: int,
) -> wp.vec3:
    return _in_window(frames[view], distance[view], window, in_radii(corner, spheres, table, view))


@part
@no_type_check
def _draw(
    a: wp.vec3,
    b: wp.vec3,
    c: wp.vec3,
    area: float,
    table: Ints2,
    maps: Ints,
    view: int,
    layer: int,
    lane: int,
    lanes: int,
):
    """Lower a layer of a map to a face, in every so many pixels of its box."""
    map_px = table[view, MAP_PX]
    first = table[view, MAP_AT] + layer * map_px * map_px
    box = covered_centres(a, b, c, map_px, map_px)
    columns = box[1] - box[0]
    index = int(lane)
    while index < columns * (box[3] - box[2]):
        x = box[0] + index % columns
        y = box[2] + index / columns
        depth = fragment_depth(a, b, c, area, float(x) + 0.5, float(y) + 0.5)
        if depth > 0.0:
            wp.atomic_min(maps, first + y * map_px + x, wp.cast(depth, wp.int32))
        index += lanes


@part
@no_type_check
def _where_mesh_ends_light(maps: Ints, first: int, layer: int, most: float) -> float:
    """Find the depth at which the mesh alone ends light; arguments as of `_where_light_ends`."""
    enters = wp.cast(maps[first + FRONTS * layer], wp.float32)
    ends = enters
    if maps[first + BACKS * layer] < _INFINITE:
        ends = enters + wp.min(0.5 * (wp.cast(maps[first + BACKS * layer], wp.float32) - enters), most)
    return ends


@part
@no_type_check
def _where_light_ends(maps: Ints, first: int, layer: int, most: float, contact: float) -> wp.vec2:
    """Find the depths at which light enters the mesh, minus infinity before another triangle, and at which it ends.

    `first` is the pixel in the first layer, and `layer` the pixels of one.
    """
    enters = wp.cast(maps[first + FRONTS * layer], wp.float32)
    ends = _where_mesh_ends_light(maps, first, layer, most)
    blocker = wp.cast(maps[first + OTHERS * layer], wp.float32) + contact
    if blocker < enters:
        enters = wp.float32(-3.0e38)
    return wp.vec2(enters, wp.min(ends, blocker))


@kernel
@no_type_check
def look_up(
    count: Ints,
    spheres: Floats2,
    frames: Matrices,
    distance: Floats,
    table: Ints2,
    points: Vectors,
    bounds: Ints2,
    maps: Ints,
    lengths: Floats2,
    lit: Floats2,
    depth_in: Floats2,
    alone: Floats2,
):
    """Fill the share of the four nearest pixels in which points are lit, and their depth behind the surface.

    `lengths` are each sphere's tolerance, contact, max_depth_in and template_m (`light.shadow_maps.ShadowScene`).
    `alone` is as `lit` of the first views, were there no other triangles.
    """
    view, index = wp.tid()
    total = points_of(table, view, count[0])
    if index >= total:
        return
    map_px = table[view, MAP_PX]
    window = window_of(distance[view], bounds, view, total, map_px)
    point = in_radii(points[table[view, FIRST_POINT] + index], spheres, table, view)
    place = _in_window(frames[view], distance[view], window, point)
    x = place[0] - 0.5
    y = place[1] - 0.5
    depth = place[2]
    limit = float(map_px - 1)
    if not (x >= 0.0 and y >= 0.0 and x < limit and y < limit and depth > 0.0):
        lit[view, index] = 1.0
        depth_in[view, index] = 0.0
        if view < alone.shape[0]:
            alone[view, index] = 1.0
        return
    column = int(x)
    row = int(y)
    right = x - float(column)
    below = y - float(row)
    most = _STEEPEST / wp.min(window[2], window[3])
    of = table[view, SPHERE]
    share = wp.float32(0.0)
    of_mesh = wp.float32(0.0)
    inside = wp.float32(0.0)
    for corner in range(4):
        across_x = corner % 2
        across_y = corner / 2
        weight = wp.where(across_x == 1, right, 1.0 - right) * wp.where(across_y == 1, below, 1.0 - below)
        pixel = table[view, MAP_AT] + (row + across_y) * map_px + column + across_x
        way = _where_light_ends(maps, pixel, map_px * map_px, most, lengths[of, 1])
        if depth - lengths[of, 0] <= way[1]:
            share += weight
        if depth - lengths[of, 0] <= _where_mesh_ends_light(maps, pixel, map_px * map_px, most):
            of_mesh += weight
        if way[0] < 3.0e38:
            inside += weight * wp.clamp(depth - way[0], -lengths[of, 2], lengths[of, 2])
    lit[view, index] = share
    depth_in[view, index] = wp.max(inside, 0.0) * lengths[of, 3]
    if view < alone.shape[0]:
        alone[view, index] = of_mesh


@kernel
@no_type_check
def draw_nearest(px: Vectors2, faces: Longs2, map_px: int, maps: Ints2):
    """Lower maps [K, map_px^2] to the faces of a mesh whose places [K, V] in them are given, either side."""
    view, face = wp.tid()
    a = px[view, int(faces[face, 0])]
    b = px[view, int(faces[face, 1])]
    c = px[view, int(faces[face, 2])]
    area = projected_area(a, b, c)
    if area == 0.0:
        return
    box = covered_centres(a, b, c, map_px, map_px)
    for y in range(box[2], box[3]):
        for x in range(box[0], box[1]):
            depth = fragment_depth(a, b, c, area, float(x) + 0.5, float(y) + 0.5)
            if depth > 0.0:
                wp.atomic_min(maps, view, y * map_px + x, wp.cast(depth, wp.int32))


@kernel
@no_type_check
def fill_lit_share(lifted: Vectors2, maps: Ints2, map_px: int, bias: Floats, lit: Floats2):
    """Fill the bilinear share of the four nearest pixels of a map that do not block a lifted vertex."""
    view, vertex = wp.tid()
    place = lifted[view, vertex]
    limit = float(map_px) - 1.001
    x = wp.clamp(place[0] - 0.5, 0.0, limit)
    y = wp.clamp(place[1] - 0.5, 0.0, limit)
    column = int(x)
    row = int(y)
    right = x - float(column)
    below = y - float(row)
    share = wp.float32(0.0)
    for corner in range(4):
        across_x = corner % 2
        across_y = corner / 2
        if place[2] - bias[0] <= wp.cast(maps[view, (row + across_y) * map_px + column + across_x], wp.float32):
            share += wp.where(across_x == 1, right, 1.0 - right) * wp.where(across_y == 1, below, 1.0 - below)
    lit[view, vertex] = share
