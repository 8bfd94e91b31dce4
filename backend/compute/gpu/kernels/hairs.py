"""Hairs over the full-size image: as `surface.hairs`.

What they cover of pixels, and their colours there, are summed as whole numbers, whose sum does not depend on the order
of threads.
"""

from __future__ import annotations

from math import pi
from typing import no_type_check

import warp as wp

from ....geometry.tolerances import NEAR_M
from ....surface.hairs import (
    ABOVE_SKIN_M,
    EVEN,
    LEAST_COSINE_SQUARED,
    MIRRORED_RAD,
    MOST_POINTS,
    REFLECTED,
    SEGMENTS,
    STEP_PX,
)
from .compiled import Floats, Floats2, Ints, Longs2, Vectors, Vectors2, kernel, part
from .lobes import TINY
from .raster import projected_point

_SEGMENTS, _MOST_POINTS, _STEP_PX = wp.constant(SEGMENTS), wp.constant(MOST_POINTS), wp.constant(STEP_PX)
_NEAR_M, _BEHIND_M, _PI = wp.constant(NEAR_M), wp.constant(ABOVE_SKIN_M), wp.constant(pi)
_EVEN, _REFLECTED, _LEAST_COSINE = wp.constant(EVEN), wp.constant(REFLECTED), wp.constant(LEAST_COSINE_SQUARED)
_MIRRORED_RAD, _OF_CONE = wp.constant(MIRRORED_RAD), wp.constant(2 * MIRRORED_RAD * (2 * pi) ** 0.5)
WHOLE = wp.constant(wp.float64(2.0**32))
"""What stands for 1 in sums: of a pixel's area, and of the unit of light."""
_NO_RAY = wp.constant(-1)


@part
@no_type_check
def _pixel_at(place: wp.vec3, halving: float, window: Ints, times: int) -> wp.vec2i:
    """Find column and row of a place of the full-size image, in one of `times` the window; (-1, -1): beside it."""
    x = wp.floor(place[0] * halving)
    y = wp.floor(place[1] * halving)
    found = wp.vec2i(-1, -1)
    if x >= 0.0 and y >= 0.0 and x < float(times * window[0]) and y < float(times * window[1]):
        found = wp.vec2i(int(x), int(y))
    return found


@kernel
@no_type_check
def pose_hairs(
    count: Ints,
    corners: Longs2,
    weights: Vectors,
    rise: Vectors,
    bend: Vectors,
    vertices: Vectors,
    vertex_normal: Vectors,
    scale: Floats,
    K: Floats2,
    world2cam: Floats2,
    window: Ints,
    width: int,
    row: Ints,
    depth: Floats,
    points: Vectors2,
    placed: Vectors2,
    normal: Vectors,
    ray: Ints,
    longest_bits: Ints,
):
    """Fill points [N, S + 1] of hairs, world and projected, and the ray that each has its light of; -1: not shown.

    `row` [h * w] is the ray of a low-resolution pixel, -1 for none, `depth` [H * W] of the skin, m, and `longest_bits`
    is raised to those of the longest piece, px.
    """
    hair = wp.tid()
    if hair >= count[0]:
        return
    a = vertices[int(corners[hair, 0])]
    b = vertices[int(corners[hair, 1])]
    c = vertices[int(corners[hair, 2])]
    share = weights[hair]
    mixed = (
        share[0] * vertex_normal[int(corners[hair, 0])]
        + share[1] * vertex_normal[int(corners[hair, 1])]
        + share[2] * vertex_normal[int(corners[hair, 2])]
    )
    upward = wp.normalize(mixed)
    normal[hair] = upward
    root = share[0] * a + share[1] * b + share[2] * c
    along = rise[hair][0] * (b - a) + rise[hair][1] * (c - a) + rise[hair][2] * scale[0] * upward
    aside = bend[hair][0] * (b - a) + bend[hair][1] * (c - a) + bend[hair][2] * scale[0] * upward
    is_before = wp.bool(True)
    is_seen = wp.bool(False)
    longest = wp.float32(0.0)
    for k in range(_SEGMENTS + 1):
        t = float(k) / float(_SEGMENTS)
        point = root + t * along + t * t * aside
        place = projected_point(point, K, world2cam)
        points[hair, k] = point
        placed[hair, k] = place
        is_before = is_before and place[2] > _NEAR_M
        at = _pixel_at(place, 1.0, window, 2)
        if is_before and at[0] >= 0:
            is_seen = is_seen or place[2] - _BEHIND_M * scale[0] <= depth[at[1] * 2 * width + at[0]]
        if k > 0:
            last = placed[hair, k - 1]
            longest = wp.max(longest, wp.length(wp.vec2(place[0] - last[0], place[1] - last[1])))
    ray[hair] = _NO_RAY
    if not is_before or not is_seen:
        return
    at = _pixel_at(placed[hair, 0], 0.5, window, 1)
    if at[0] >= 0 and row[at[1] * width + at[0]] >= 0:
        ray[hair] = row[at[1] * width + at[0]]
        wp.atomic_max(longest_bits, 0, wp.cast(longest, wp.int32))


@part
@no_type_check
def _mirrored(sine_in: float, sine_out: float) -> float:
    angle_in = wp.asin(wp.clamp(sine_in, -1.0, 1.0))
    angle_out = wp.asin(wp.clamp(sine_out, -1.0, 1.0))
    half = 0.5 * (angle_in + angle_out) / _MIRRORED_RAD
    cosine = wp.cos(0.5 * (angle_in - angle_out))
    return _PI * _REFLECTED * wp.exp(-0.5 * half * half) / _OF_CONE / wp.max(cosine * cosine, _LEAST_COSINE)


@part
@no_type_check
def _of_row(light: Floats2, ray: int, column: int) -> wp.vec3:
    return wp.vec3(light[ray, column], light[ray, column + 1], light[ray, column + 2])


@part
@no_type_check
def hair_colour(
    light: Floats2, ray: int, lamp_rgb: Vectors, tangent: wp.vec3, normal: wp.vec3, view: wp.vec3, albedo: Floats
) -> wp.vec3:
    """Compute the colour of a piece of hair, as `surface.hairs.hair_colours`; rows of light as in `relit_pixels`."""
    lamps = lamp_rgb.shape[0]
    sine_out = -wp.dot(view, tangent)
    cosine_out = wp.sqrt(wp.max(1.0 - sine_out * sine_out, 0.0))
    diffuse = wp.vec3()
    mirrored = wp.vec3()
    for lamp in range(lamps):
        arriving = _of_row(light, ray, 3 * lamp)
        strength = wp.length(arriving)
        towards = arriving / wp.max(strength, TINY)
        sine_in = wp.dot(towards, tangent)
        cosine_in = wp.sqrt(wp.max(1.0 - sine_in * sine_in, 0.0))
        facing = (-wp.dot(towards, view) - sine_in * sine_out) / wp.max(cosine_in * cosine_out, TINY)
        facing = wp.clamp(facing, -1.0, 1.0)
        across = wp.acos(facing)
        diffuse += strength * cosine_in * (wp.sin(across) + (_PI - across) * facing) * 0.25 * lamp_rgb[lamp]
        cone = _mirrored(sine_in, sine_out)
        mirrored += strength * cosine_in * cone * 0.25 * wp.cos(0.5 * across) * lamp_rgb[lamp]
    arrives = _of_row(light, ray, 3 * lamps + 23)
    reflected = _of_row(light, ray, 3 * lamps + 26)
    colour = wp.vec3()
    for k in range(3):
        of_sky = wp.float32(0.0)
        for axis in range(3):
            of_sky += normal[axis] * light[ray, 3 * lamps + 3 * axis + k]
        even = wp.max(of_sky, 0.0) * arrives[k] + reflected[k]
        of_lamps = diffuse[k] * albedo[k] + mirrored[k]
        colour[k] = of_lamps * arrives[k] + _EVEN * (albedo[k] + _REFLECTED) * even
    return colour


@part
@no_type_check
def _add(sums: Longs2, pixel: int, column: int, value: float):
    wp.atomic_add(sums, pixel, column, wp.int64(wp.float64(value) * WHOLE))


@kernel
@no_type_check
def draw_hairs(
    count: Ints,
    points: Vectors2,
    placed: Vectors2,
    normal: Vectors,
    radius_m: Floats,
    ray: Ints,
    longest_bits: Ints,
    units: Floats,
    view: Vectors,
    window: Ints,
    width: int,
    depth: Floats,
    light: Floats2,
    lamp_rgb: Vectors,
    albedo: Floats,
    unit: Floats,
    sums: Longs2,
    depth_bits: Ints,
):
    """Add the pieces of hairs [N, S] to sums [H * W, 4]: colour times covered area, in units of light, and that area.

    `units` are the shell's half-width, the focal length of rays' images, px, and the hand's scale; `depth_bits` are
    lowered to those of the nearest hair.
    """
    hair, segment = wp.tid()
    if hair >= count[0]:
        return
    own = ray[hair]
    if own < 0:
        return
    first = points[hair, segment]
    last = points[hair, segment + 1]
    seen = wp.normalize(0.5 * (first + last) - view[0])
    tangent = wp.normalize(last - first)
    colour = hair_colour(light, own, lamp_rgb, tangent, normal[hair], seen, albedo) / unit[0]
    start = placed[hair, segment]
    way = placed[hair, segment + 1] - start
    length_px = wp.length(wp.vec2(way[0], way[1]))
    parts = wp.clamp(int(wp.ceil(wp.cast(longest_bits[0], wp.float32) / _STEP_PX)), 1, _MOST_POINTS)
    for index in range(parts):
        share = (float(index) + 0.5) / float(parts)
        along = (float(segment) + share) / float(_SEGMENTS)
        at = start + share * way
        width_px = 2.0 * radius_m[hair] * units[2] * (1.0 - along) * 2.0 * units[1] / at[2]
        _draw_point(at, width_px * length_px / float(parts), units[2], window, width, depth, colour, sums, depth_bits)


@part
@no_type_check
def _draw_point(
    at: wp.vec3,
    area: float,
    scale: float,
    window: Ints,
    width: int,
    depth: Floats,
    colour: wp.vec3,
    sums: Longs2,
    depth_bits: Ints,
):
    """Add a point on a hair to the four pixels around it, where it lies before their skin."""
    left = wp.floor(at[0] - 0.5)
    top = wp.floor(at[1] - 0.5)
    right = at[0] - 0.5 - left
    below = at[1] - 0.5 - top
    is_seen = wp.bool(False)
    for corner in range(4):
        x = int(left) + corner % 2
        y = int(top) + corner / 2
        if x >= 0 and y >= 0 and x < 2 * window[0] and y < 2 * window[1]:
            pixel = y * 2 * width + x
            weight = wp.where(corner % 2 == 1, right, 1.0 - right) * wp.where(corner / 2 == 1, below, 1.0 - below)
            if weight * area > 0.0 and at[2] - _BEHIND_M * scale <= depth[pixel]:
                is_seen = wp.bool(True)
                for k in range(3):
                    _add(sums, pixel, k, colour[k] * weight * area)
                _add(sums, pixel, 3, weight * area)
    if is_seen:
        for corner in range(4):
            x = wp.clamp(int(left) + corner % 2, 0, 2 * window[0] - 1)
            y = wp.clamp(int(top) + corner / 2, 0, 2 * window[1] - 1)
            wp.atomic_min(depth_bits, y * 2 * width + x, wp.cast(at[2], wp.int32))
