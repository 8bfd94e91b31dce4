"""Frames in a capture's light: as `light.visibility`, `field.field.BakedField`, `image.maps` and `image.decode`."""

from __future__ import annotations

from typing import Any, no_type_check

import warp as wp

from ....field.field import CHANNELS, MIN_ALPHA
from ....image.decode import MIN_ALPHA as LEAST_ALPHA
from ....light.visibility import MAP_PX, STAND_OFF
from ....records.frame import DEPTH_BACKGROUND
from .compiled import Floats, Floats2, Floats3, Ints, Longs, Matrices, Vectors, Vectors2, kernel, part
from .pixels import bilinear, enlarged_value, neighbours

wp.set_module_options({"fuse_fp": False})  # strict, as what `shadow` compares with what this places
_MAP_PX, _STAND_OFF = wp.constant(float(MAP_PX)), wp.constant(STAND_OFF)
_MIN_ALPHA, _LEAST_ALPHA, _TINY = wp.constant(MIN_ALPHA), wp.constant(LEAST_ALPHA), wp.constant(1e-12)
_COLOURS, _CHANNELS, _BACKGROUND = wp.constant(3), wp.constant(CHANNELS), wp.constant(DEPTH_BACKGROUND)
_GAIN, _BIAS = wp.constant(0), wp.constant(3)


@part
@no_type_check
def _in_map(frame: wp.mat33, offset: wp.vec3, radius: float) -> wp.vec3:
    place = (frame * offset) / radius
    x = (place[0] * 0.5 + 0.5) * (_MAP_PX - 2.0) + 1.0
    y = (place[1] * 0.5 + 0.5) * (_MAP_PX - 2.0) + 1.0
    return wp.vec3(x, y, _STAND_OFF - place[2])


@kernel
@no_type_check
def place_in_maps(
    vertices: Vectors, normals: Vectors, sphere: Floats, frames: Matrices, placed: Vectors2, lifted: Vectors2
):
    """Fill the places [K, V] of vertices, and of such lifted off the mesh, in the maps of directions: px, and radii.

    `sphere` is its centre, its radius, and by how much is lifted, m.
    """
    view, vertex = wp.tid()
    offset = vertices[vertex] - wp.vec3(sphere[0], sphere[1], sphere[2])
    placed[view, vertex] = _in_map(frames[view], offset, sphere[3])
    lifted[view, vertex] = _in_map(frames[view], offset + sphere[4] * normals[vertex], sphere[3])


@kernel
@no_type_check
def light_codes(
    normals: Vectors, frames: Matrices, lit: Floats2, weight: Floats2, bias: Floats, first: int, channels: Floats2
):
    """Fill the code of the light that reaches vertices, among their channels from `first` on."""
    vertex, code = wp.tid()
    total = float(bias[code])
    for view in range(frames.shape[0]):
        towards = wp.vec3(frames[view][2, 0], frames[view][2, 1], frames[view][2, 2])
        cosine = wp.max(wp.dot(normals[vertex], towards), 0.0)
        total += weight[code, view] * cosine * lit[view, vertex]
    channels[vertex, first + code] = total


@kernel
@no_type_check
def baked_inputs(
    count: Ints,
    channels: Floats2,
    alpha: Floats,
    relief_at: int,
    directions: Vectors,
    out: wp.array2d(dtype=Any),
):
    """Fill the decoder's inputs of rays [R]: their mean features, and how they meet the relief normal among these."""
    ray = wp.tid()
    if ray >= count[0]:
        return
    gathered = channels.shape[1]
    whole = 1.0 / wp.max(alpha[ray], _MIN_ALPHA)
    for k in range(gathered):
        out[ray, k] = out.dtype(channels[ray, k] * whole)
    relief = wp.vec3()
    for k in range(3):
        relief[k] = channels[ray, relief_at + k] * whole
    normal = relief / wp.max(wp.length(relief), _TINY)
    view = wp.normalize(directions[ray])
    facing = -wp.dot(normal, view)
    reflected = view + 2.0 * facing * normal
    grazing = 1.0 - wp.clamp(facing, 0.0, 1.0)
    squared = grazing * grazing
    for k in range(3):
        out[ray, gathered + k] = out.dtype(reflected[k])
    out[ray, gathered + 3] = out.dtype(facing)
    out[ray, gathered + 4] = out.dtype(squared * squared * grazing)


@kernel
@no_type_check
def paint_rays(
    count: Ints,
    pixel: Longs,
    width: int,
    raw: Floats2,
    alpha: Floats,
    mean_m: Floats,
    maps: Floats2,
    padded: wp.array2d(dtype=Any),
    depth: Floats,
):
    """Paint decoded rays [R], premultiplied, and alpha into maps [h * w, C], and such with a border; and depths, m."""
    ray = wp.tid()
    if ray >= count[0]:
        return
    at = int(pixel[ray])
    place = (at / width + 1) * (width + 2) + at % width + 1
    for k in range(_CHANNELS):
        value = float(raw[ray, k])
        if k < _COLOURS:
            value = 1.0 / (1.0 + wp.exp(-value))
        value *= alpha[ray]
        maps[at, k] = value
        padded[place, k] = padded.dtype(value)
    maps[at, _CHANNELS] = alpha[ray]
    padded[place, _CHANNELS] = padded.dtype(alpha[ray])
    if alpha[ray] > 0.0:
        depth[at] = mean_m[ray]


@part
@no_type_check
def _linear(encoded: float) -> float:
    value = encoded / 12.92
    if encoded > 0.04045:
        value = wp.pow((encoded + 0.055) / 1.055, 2.4)
    return value


@kernel
@no_type_check
def decode_pixels(
    maps: Floats3,
    tail: Floats2,
    window: Ints,
    grade: Floats,
    depth_of_rays: Floats,
    rgb: Vectors,
    pixel_alpha: Floats,
    pixel_depth: Floats,
):
    """Fill the pixels of the image [H * W], scene-linear and premultiplied: enlarged maps [C, h, w] and `tail`.

    `tail` are rows of low-resolution pixels with a border of one, of 4 channels for each of 4 pixels; `grade` is a gain
    of the colours, and what is added to them times alpha. Beside `window` there is nothing.
    """
    pixel = wp.tid()
    width = maps.shape[2]
    x = pixel % (2 * width)
    y = pixel / (2 * width)
    rgb[pixel] = wp.vec3()
    pixel_alpha[pixel] = 0.0
    pixel_depth[pixel] = _BACKGROUND
    if x >= 2 * window[0] or y >= 2 * window[1]:
        return
    around = neighbours(pixel, width, maps.shape[1])
    weights = bilinear(pixel, width)
    row = (y / 2 + 1) * (width + 2) + x / 2 + 1
    corner = 2 * (y % 2) + x % 2
    enlarged = enlarged_value(maps, _CHANNELS, around, weights) + tail[row, 4 * _COLOURS + corner]
    alpha = wp.min(enlarged, 1.0)
    if not alpha > _LEAST_ALPHA:
        return
    colour = wp.vec3()
    for k in range(_COLOURS):
        value = enlarged_value(maps, k, around, weights) + tail[row, 4 * k + corner]
        value = grade[_GAIN + k] * value + grade[_BIAS + k] * enlarged
        colour[k] = _linear(wp.min(wp.max(value, 0.0), alpha) / alpha) * alpha
    rgb[pixel] = colour
    pixel_alpha[pixel] = alpha
    depth = depth_of_rays[(y / 2) * width + x / 2]
    if alpha >= 0.5 and wp.isfinite(depth):
        pixel_depth[pixel] = depth


for _kind in (wp.float16, wp.float32):
    wp.overload(baked_inputs, {"out": wp.array2d(dtype=_kind)})
    wp.overload(paint_rays, {"padded": wp.array2d(dtype=_kind)})
