"""Where rays meet the skin, and their maps: as `render.primary_hits`, `surface.hole_filling`, `image.shading`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....field.field import MIN_ALPHA
from ....surface.detail_mesh import CLOSE_M, FAR_M
from ....surface.hole_filling import BEHIND, CLEAR, LEAST_OPACITY, LEAST_WEIGHT, OPAQUE
from ....surface.ray_hits import SAME_PART
from .compiled import Bools, Floats, Floats2, Ints, Ints2, Keys, Longs, Longs2, Vectors, Vectors2, kernel, part
from .features import barycentric_on
from .raster import depth_of, direction_of, face_of, projected_point

wp.set_module_options({"fuse_fp": False})  # strict, as what `raster` compares with what this projects
_CLOSE_M, _FAR_M, _SAME_PART = wp.constant(CLOSE_M), wp.constant(FAR_M), wp.constant(SAME_PART)
_MIN_ALPHA, _CLEAR, _OPAQUE, _BEHIND = (wp.constant(v) for v in (MIN_ALPHA, CLEAR, OPAQUE, BEHIND))
_LEAST_OPACITY, _LEAST_WEIGHT, _TINY = wp.constant(LEAST_OPACITY), wp.constant(LEAST_WEIGHT), wp.constant(1e-12)
INFLATED, DEFLATED, MESH, STANDING_OUT = (wp.constant(value) for value in range(4))
"""Rows of projected layers: the shell about the mesh as rays meet it, the mesh, and with all that may stand out."""
SHELL, OUTER = wp.constant(0), wp.constant(1)
"""Of the lifts: the shell's half-width, and how far the skin may stand out of the mesh, m."""


@kernel
@no_type_check
def project_layers(
    vertices: Vectors,
    normals: Vectors,
    fine: Vectors,
    K: Floats2,
    world2cam: Floats2,
    scale: Floats,
    lifts_m: Floats,
    moved: Vectors,
    layers: Vectors2,
    points: Vectors,
    casters: Vectors,
):
    """Fill the mesh as rays meet it, moved onto the surface as `detail_mesh.on_surface`, and layers [4, V] in px.

    Its vertices are the first of the points that shadows fall on, and of what casts them.
    """
    vertex = wp.tid()
    place = vertices[vertex]
    normal = normals[vertex]
    off_m = wp.dot(fine[vertex] - place, normal)
    share = wp.clamp((wp.abs(off_m) / scale[0] - _CLOSE_M) / (_FAR_M - _CLOSE_M), 0.0, 1.0)
    met = place + share * share * (3.0 - 2.0 * share) * off_m * normal
    moved[vertex] = met
    points[vertex] = place
    casters[vertex] = place
    layers[INFLATED, vertex] = projected_point(met + lifts_m[SHELL] * normal, K, world2cam)
    layers[DEFLATED, vertex] = projected_point(met - lifts_m[SHELL] * normal, K, world2cam)
    layers[MESH, vertex] = projected_point(place, K, world2cam)
    layers[STANDING_OUT, vertex] = projected_point(place + lifts_m[OUTER] * normal, K, world2cam)


@kernel
@no_type_check
def list_rays(
    is_live: Bools,
    stopped: Bools,
    view: Vectors,
    width: int,
    window: Ints,
    surface_m: Floats,
    capacity: int,
    count: Ints,
    pixel: Longs,
    row: Ints,
    directions: Vectors,
    is_stopped: Bools,
    overflow: Ints,
):
    """List the pixels whose rays are sampled, or meet the avatar's surface; `row` is -1 where it was, for none.

    None are listed beside the first columns and rows that `window` says.
    """
    at = wp.tid()
    if at % width >= window[0] or at / width >= window[1]:
        return
    if not is_live[at] and not wp.isfinite(surface_m[at]):
        return
    slot = wp.atomic_add(count, 0, 1)
    if slot >= capacity:
        overflow[0] = 1
        return
    pixel[slot] = wp.int64(at)
    row[at] = slot
    directions[slot] = direction_of(view, at, width)
    is_stopped[slot] = is_live[at] and stopped[at]


@part
@no_type_check
def _is_other_part(hit_m: float, depth: float, edge_m: float) -> bool:
    return wp.isfinite(hit_m) and wp.abs(hit_m - depth) > _SAME_PART * edge_m


@part
@no_type_check
def _unit(vector: wp.vec3) -> wp.vec3:
    return vector / wp.max(wp.length(vector), _TINY)


@part
@no_type_check
def _own_share(alpha: float, hit_m: float) -> float:
    """Compute how much a ray counts for what it gathered, as `surface.hole_filling.own_share`."""
    share = wp.float32(1.0)
    if wp.isfinite(hit_m):
        share = wp.clamp((alpha - _CLEAR) / (_OPAQUE - _CLEAR), 0.0, 1.0)
    return share


@part
@no_type_check
def _shown_behind(t: Floats2, weights: Floats2, ray: int, middle: float) -> bool:
    """Return whether most of a ray's opacity lies behind a depth."""
    behind = wp.float32(0.0)
    total = wp.float32(0.0)
    for index in range(t.shape[1]):
        total += weights[ray, index]
        if t[ray, index] > middle:
            behind += weights[ray, index]
    return behind > 0.5 * total


@kernel
@no_type_check
def meet_skin(
    count: Ints,
    pixel: Longs,
    width: int,
    view: Vectors,
    mesh: Keys,
    outer: Keys,
    hit_m: Floats,
    hit_normal: Vectors,
    t: Floats2,
    dt: Floats,
    weights: Floats2,
    channels: Floats2,
    alpha: Floats,
    near_channels: int,
    vertices: Vectors,
    faces: Longs2,
    edge_m: Floats,
    corner: Longs2,
    corner_weight: Floats2,
    position: Vectors,
    on_surface: Vectors,
    view_direction: Vectors,
    normal: Vectors,
    relief_normal: Vectors,
):
    """Fill where rays [R] first meet the skin, as `primary_hits` with the rays shown, and `surface_points`.

    `mesh` and `outer` are the words of pixels, `hit_m` and `hit_normal` of the avatar's surface.
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    at = int(pixel[ray])
    direction = direction_of(view, at, width)
    of_mesh = depth_of(mesh[at])
    of_outer = depth_of(outer[at])
    depth = of_mesh
    face = face_of(mesh[at])
    if of_mesh - of_outer > edge_m[0]:
        if not (wp.isfinite(of_mesh) and _shown_behind(t, weights, ray, 0.5 * (of_mesh + of_outer))):
            depth = of_outer
            face = face_of(outer[at])
    hit = hit_m[at]
    meets = wp.isfinite(hit)
    if _is_other_part(hit, depth, edge_m[0]):
        depth = hit
        face = wp.int32(-1)
    if not wp.isfinite(depth):
        depth = t[ray, 0] + 0.5 * float(t.shape[1] - 1) * dt[ray]
    place = view[0] + depth * direction
    position[ray] = place
    on_surface[ray] = place
    if meets:
        on_surface[ray] = view[0] + hit * direction
    view_direction[ray] = wp.normalize(direction)
    of_face = wp.max(face, 0)
    shares = barycentric_on(vertices, faces, face, place)
    for k in range(3):
        corner[ray, k] = faces[of_face, k]
        corner_weight[ray, k] = shares[k]
    whole = 1.0 / wp.max(alpha[ray], _MIN_ALPHA)
    smooth = wp.vec3()
    relief = wp.vec3()
    for k in range(3):
        smooth[k] = channels[ray, near_channels + k] * whole
        relief[k] = channels[ray, near_channels + 3 + k] * whole
    relief_normal[ray] = _unit(relief)
    normal[ray] = _unit(smooth)
    if meets:
        normal[ray] = hit_normal[at]
        own = _own_share(alpha[ray], hit)
        if own < 1.0:
            relief_normal[ray] = _unit(own * relief_normal[ray] + (1.0 - own) * hit_normal[at])


@kernel
@no_type_check
def paint_maps(
    count: Ints,
    pixel: Longs,
    row: Ints,
    width: int,
    low: Floats2,
    alpha: Floats,
    hit_m: Floats,
    edge_m: Floats,
    around: Ints2,
    relief_normal: Vectors,
    position: Vectors,
    view_direction: Vectors,
    world2cam: Floats2,
    channels: int,
    maps: Floats2,
    padded: Floats2,
    depth: Floats,
):
    """Paint rays [R] into maps [h * w, C], without holes, and into such with a border; and their depths, m.

    As `surface.hole_filling.inpaint` and `drop_outliers`, then `image.shading.relightable_maps`; `low` [R, >= C] is
    decoded and premultiplied, `around` [S, 3] are columns and rows aside and the square of the radius, px.
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    at = int(pixel[ray])
    x = at % width
    y = at / width
    height = row.shape[0] / width
    own = _own_share(alpha[ray], hit_m[at])
    total = wp.float32(0.0)
    opacity = float(alpha[ray])
    if own < 1.0:
        filled = wp.float32(0.0)
        for k in range(around.shape[0]):
            weight = _weight_around(row, width, height, x, y, around, k, alpha, hit_m, hit_m[at], edge_m[0])
            if weight > 0.0:
                total += weight
                filled += weight * alpha[row[(y + around[k, 1]) * width + x + around[k, 0]]]
        if total > _LEAST_WEIGHT:
            opacity = filled / total + own * (alpha[ray] - filled / total)
    place = (y + 1) * (width + 2) + x + 1
    for c in range(channels):
        value = float(low[ray, c])
        if total > _LEAST_WEIGHT:
            mean = wp.float32(0.0)
            for k in range(around.shape[0]):
                weight = _weight_around(row, width, height, x, y, around, k, alpha, hit_m, hit_m[at], edge_m[0])
                if weight > 0.0:
                    other = row[(y + around[k, 1]) * width + x + around[k, 0]]
                    mean += weight / total * (low[other, c] / wp.max(alpha[other], _LEAST_OPACITY))
            straight = value / wp.max(alpha[ray], _LEAST_OPACITY)
            value = (mean + own * (straight - mean)) * opacity
        maps[at, c] = value
        padded[place, c] = value
    for axis in range(3):
        turned = wp.float32(0.0)
        for k in range(3):
            turned += world2cam[axis, k] * relief_normal[ray][k]
        maps[at, channels + axis] = turned * opacity
        padded[place, channels + axis] = turned * opacity
    maps[at, channels + 3] = opacity
    padded[place, channels + 3] = opacity
    point = position[ray]
    if not wp.isfinite(hit_m[at]) and opacity < _CLEAR:
        point = point + _BEHIND * edge_m[0] * view_direction[ray]
    forward = wp.vec3(world2cam[2, 0], world2cam[2, 1], world2cam[2, 2])
    depth[at] = wp.dot(point, forward) + world2cam[2, 3]


@part
@no_type_check
def _weight_around(
    row: Ints,
    width: int,
    height: int,
    x: int,
    y: int,
    around: Ints2,
    k: int,
    alpha: Floats,
    hit_m: Floats,
    own_m: float,
    edge_m: float,
) -> float:
    """Compute the weight of a ray on a ring around one; 0 for none."""
    weight = wp.float32(0.0)
    there_x = x + around[k, 0]
    there_y = y + around[k, 1]
    if there_x >= 0 and there_x < width and there_y >= 0 and there_y < height:
        at = there_y * width + there_x
        other = row[at]
        if other >= 0 and wp.isfinite(hit_m[at]):
            gap = (hit_m[at] - own_m) / edge_m
            weight = _own_share(alpha[other], hit_m[at]) * wp.exp(-gap * gap) / float(around[k, 2])
    return weight


@kernel
@no_type_check
def list_covered(
    row: Ints,
    width: int,
    view: Vectors,
    capacity: int,
    count: Ints,
    pixel: Longs,
    view_direction: Vectors,
    overflow: Ints,
):
    """List the full-size pixels that an enlargement of the rays reaches, with their unit directions."""
    at = wp.tid()
    height = row.shape[0] / width
    x = at % (2 * width)
    y = at / (2 * width)
    top = wp.max((y + 1) / 2 - 1, 0) * width
    bottom = wp.min((y + 1) / 2, height - 1) * width
    left = wp.max((x + 1) / 2 - 1, 0)
    right = wp.min((x + 1) / 2, width - 1)
    first = wp.max(row[top + left], row[top + right])
    if wp.max(first, wp.max(row[bottom + left], row[bottom + right])) < 0:
        return
    slot = wp.atomic_add(count, 0, 1)
    if slot >= capacity:
        overflow[0] = 1
        return
    pixel[slot] = wp.int64(at)
    view_direction[slot] = wp.normalize(direction_of(view, at, 2 * width))
