"""The full-size image of a relightable hand: as `image.shading` and `image.edge_avoiding_filter`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....image.depth_steps import LEAST_OPACITY
from ....image.edge_avoiding_filter import FACING_POWER, SHARES
from ....image.shading import MIN_ALPHA
from ....image.superres import RELIGHTABLE_DETAIL
from ....light.lamp_samples import HARD_RAD
from ....light.lighting import COEFFICIENTS, SMOOTH
from .compiled import Floats, Floats2, Floats3, Ints, Longs, Vectors, kernel, part
from .lobes import TINY

_LEAST_SHARE, _OF_PIXEL, _OF_NEXT = wp.constant(0.01), wp.constant(0.5), wp.constant(0.125)
_MIN_ALPHA, _COEFFICIENTS, _SMOOTH = wp.constant(MIN_ALPHA), wp.constant(COEFFICIENTS), wp.constant(SMOOTH)
_OF_ITSELF, _OF_SIDE, _OF_CORNER = (wp.constant(value) for value in SHARES)
_LEAST_OPACITY, _HARD_RAD = wp.constant(LEAST_OPACITY), wp.constant(HARD_RAD)
_FACING_POWER, _DETAIL = wp.constant(float(FACING_POWER)), wp.constant(RELIGHTABLE_DETAIL)


@part
@no_type_check
def neighbours(pixel: int, width: int, height: int) -> wp.vec4i:
    """Find the four low-resolution pixels around a full-size one."""
    row = pixel / (2 * width)
    column = pixel % (2 * width)
    top = wp.max((row + 1) / 2 - 1, 0)
    left = wp.max((column + 1) / 2 - 1, 0)
    bottom = wp.min((row + 1) / 2, height - 1)
    right = wp.min((column + 1) / 2, width - 1)
    return wp.vec4i(top * width + left, top * width + right, bottom * width + left, bottom * width + right)


@part
@no_type_check
def bilinear(pixel: int, width: int) -> wp.vec4:
    """Compute the weights of the four low-resolution pixels around a full-size one."""
    below = 0.75 - 0.5 * float((pixel / (2 * width)) % 2)
    right = 0.75 - 0.5 * float((pixel % (2 * width)) % 2)
    return wp.vec4((1.0 - below) * (1.0 - right), (1.0 - below) * right, below * (1.0 - right), below * right)


@part
@no_type_check
def _guided(share: wp.vec4, depths: wp.vec4, depth: float, edge_m: float) -> wp.vec4:
    """Keep the shares of the rays at a depth, or of all if none is there."""
    kept = wp.vec4()
    total = wp.float32(0.0)
    plain = wp.float32(0.0)
    for k in range(4):
        if share[k] > 0.0 and wp.isfinite(depth):
            gap = (depth - depths[k]) / edge_m
            kept[k] = share[k] * wp.exp(-gap * gap)
        total += kept[k]
        plain += share[k]
    result = share / plain
    if total > _LEAST_SHARE:
        result = kept / total
    return result


@kernel
@no_type_check
def ray_shares(
    count: Ints, pixel: Longs, width: int, depth_of_rays: Floats, skin_depth: Floats, edge_m: Floats, shares: Floats2
):
    """Fill shares [P, 4] as `image.shading.shares_of_rays`.

    `depth_of_rays` [h * w] is infinite where there is no ray, `skin_depth` [H * W] beside the hand.
    """
    index = wp.tid()
    if index >= count[0]:
        return
    here = int(pixel[index])
    height = depth_of_rays.shape[0] / width
    large = 2 * width
    row = here / large
    column = here % large
    depth = skin_depth[here]
    around = neighbours(here, width, height)
    share = bilinear(here, width)
    depths = wp.vec4()
    for k in range(4):
        depths[k] = depth_of_rays[around[k]]
        if not wp.isfinite(depths[k]):
            share[k] = 0.0
    own = _guided(share, depths, depth, edge_m[0])
    beside = wp.vec4(
        skin_depth[here - wp.min(column, 1)],
        skin_depth[here + wp.min(large - 1 - column, 1)],
        skin_depth[here - large * wp.min(row, 1)],
        skin_depth[here + large * wp.min(2 * height - 1 - row, 1)],
    )
    is_edge = wp.bool(False)
    for k in range(4):
        is_edge = is_edge or wp.abs(beside[k] - depth) > edge_m[0]
    if is_edge:
        own = _OF_PIXEL * own
        for k in range(4):
            own += _OF_NEXT * _guided(share, depths, beside[k], edge_m[0])
    for k in range(4):
        shares[index, k] = own[k]


@part
@no_type_check
def _step_normal(
    pixel: int, index: int, share: Floats2, row: Ints, width: int, of_rays: Vectors, own: wp.vec3
) -> wp.vec3:
    """Compute a normal as `image.depth_steps.normals_at_steps`; `row` [h * w] is the ray of a pixel, -1 for none."""
    around = neighbours(pixel, width, row.shape[0] / width)
    even = bilinear(pixel, width)
    total = wp.float32(0.0)
    for k in range(4):
        if row[around[k]] < 0:
            even[k] = 0.0
        total += even[k]
    off = wp.float32(0.0)
    mean = wp.vec3()
    for k in range(4):
        off += wp.abs(share[index, k] - even[k] / total)
        if row[around[k]] >= 0:
            mean += share[index, k] * of_rays[row[around[k]]]
    off = wp.min(off, 1.0)
    mixed = (1.0 - off) * own + off / wp.max(wp.length(mean), TINY) * mean
    return mixed / wp.max(wp.length(mixed), TINY)


@part
@no_type_check
def _replace_coefficients(pixel: int, index: int, share: Floats2, maps: Floats3, alphas: Floats, coefficients: Floats2):
    """Replace those of a pixel as `image.depth_steps.coefficients_at_steps`; `maps` as in `enlarge_pixels`."""
    width = maps.shape[2]
    last = maps.shape[0] - 1
    around = neighbours(pixel, width, maps.shape[1])
    even = bilinear(pixel, width)
    own = wp.vec4()
    all_ = wp.float32(0.0)
    total = wp.float32(0.0)
    for k in range(4):
        opacity = wp.clamp(maps[last, around[k] / width, around[k] % width], 0.0, 1.0)
        even[k] = even[k] * opacity
        own[k] = share[index, k] * opacity
        all_ += even[k]
        total += own[k]
    off = wp.float32(0.0)
    if all_ > _LEAST_OPACITY and total > _LEAST_OPACITY:
        for k in range(4):
            off += wp.abs(own[k] / total - even[k] / all_)
    if off > 0.0:
        off = wp.min(off, 1.0)
        scale = wp.clamp(alphas[pixel], 0.0, 1.0) / total
        for c in range(_COEFFICIENTS):
            of_rays = wp.float32(0.0)
            for k in range(4):
                of_rays += share[index, k] * maps[c, around[k] / width, around[k] % width]
            coefficients[index, c] = coefficients[index, c] + off * (scale * of_rays - coefficients[index, c])


@kernel
@no_type_check
def step_normals(
    count: Ints, at: Longs, share: Floats2, row: Ints, width: int, of_rays: Vectors, normal: Vectors, out: Vectors
):
    """Fill out [P] as `image.depth_steps.normals_at_steps`."""
    index = wp.tid()
    if index >= count[0]:
        return
    out[index] = _step_normal(int(at[index]), index, share, row, width, of_rays, normal[index])


@kernel
@no_type_check
def step_coefficients(count: Ints, at: Longs, share: Floats2, maps: Floats3, alphas: Floats, coefficients: Floats2):
    """Replace coefficients as `image.depth_steps.coefficients_at_steps`."""
    index = wp.tid()
    if index >= count[0]:
        return
    _replace_coefficients(int(at[index]), index, share, maps, alphas, coefficients)


@kernel
@no_type_check
def step_pixels(
    count: Ints,
    at: Longs,
    share: Floats2,
    row: Ints,
    width: int,
    of_rays: Vectors,
    normal: Vectors,
    out: Vectors,
    maps: Floats3,
    alphas: Floats,
    coefficients: Floats2,
):
    """Do what `step_normals` and `step_coefficients` do."""
    index = wp.tid()
    if index >= count[0]:
        return
    pixel = int(at[index])
    out[index] = _step_normal(pixel, index, share, row, width, of_rays, normal[index])
    _replace_coefficients(pixel, index, share, maps, alphas, coefficients)


@part
@no_type_check
def enlarged_value(maps: Floats3, channel: int, around: wp.vec4i, weights: wp.vec4) -> float:
    """Blend a map between the four pixels about one of its enlargement."""
    width = maps.shape[2]
    value = wp.float32(0.0)
    for k in range(4):
        value += weights[k] * maps[channel, around[k] / width, around[k] % width]
    return value


@kernel
@no_type_check
def enlarge_pixels(
    count: Ints,
    maps: Floats3,
    tail: Floats2,
    stride: int,
    border: int,
    covered: Longs,
    world2cam: Floats2,
    values: Floats2,
    alphas: Floats,
):
    """Fill values [H * W, 18] of covered pixels (premultiplied coefficients, normal and weight), and their alphas.

    `maps` [C, h, w] begin with premultiplied coefficients and end with normals in camera axes and alpha. `tail` is
    added at full size: rows of low-resolution pixels, `stride` from line to line after a border of so many pixels, of
    12 channels for each of 4 pixels. The weight is alpha's share of the means over pixels.
    """
    index = wp.tid()
    if index >= count[0]:
        return
    pixel = int(covered[index])
    width = maps.shape[2]
    last = maps.shape[0] - 1
    x = pixel % (2 * width)
    y = pixel / (2 * width)
    around = neighbours(pixel, width, maps.shape[1])
    weights = bilinear(pixel, width)
    enlarged = enlarged_value(maps, last, around, weights)
    straight = 1.0 / wp.max(enlarged, _MIN_ALPHA)
    at = (y / 2 + border) * stride + x / 2 + border
    corner = 2 * (y % 2) + x % 2
    alpha = enlarged + tail[at, 4 * (_DETAIL - 1) + corner]
    weight = wp.clamp(alpha, _MIN_ALPHA, 1.0)
    for k in range(_COEFFICIENTS):
        value = enlarged_value(maps, k, around, weights) * straight
        if k >= _SMOOTH:
            value += tail[at, 4 * (k - _SMOOTH) + corner]
        values[pixel, k] = wp.max(value, 0.0) * wp.clamp(alpha, 0.0, 1.0)
    camera_normal = wp.vec3()
    for k in range(3):
        camera_normal[k] = (
            enlarged_value(maps, last - 3 + k, around, weights) * straight
            + tail[at, 4 * (_COEFFICIENTS - _SMOOTH + k) + corner]
        )
    scale = weight / wp.max(wp.length(camera_normal), TINY)
    for k in range(3):
        turned = (
            world2cam[0, k] * camera_normal[0] + world2cam[1, k] * camera_normal[1] + world2cam[2, k] * camera_normal[2]
        )
        values[pixel, _COEFFICIENTS + k] = turned * scale
    values[pixel, _COEFFICIENTS + 3] = weight
    alphas[pixel] = alpha


@kernel
@no_type_check
def smooth_pixels(count: Ints, values: Floats2, covered: Longs, width: int, coefficients: Floats2, normal: Vectors):
    """Fill the means over 3 x 3 pixels of the hand; `values` [H * W, 18] are 0 at all others."""
    index = wp.tid()
    if index >= count[0]:
        return
    pixel = int(covered[index])
    x = pixel % width
    y = pixel / width
    height = values.shape[0] / width
    total = wp.float32(0.0)
    mean = wp.vec3()
    for k in range(_COEFFICIENTS):
        coefficients[index, k] = 0.0
    for near in range(9):
        dx = near % 3 - 1
        dy = near / 3 - 1
        if x + dx >= 0 and x + dx < width and y + dy >= 0 and y + dy < height:
            at = pixel + dy * width + dx
            share = (0.5 - 0.25 * float(wp.abs(dx))) * (0.5 - 0.25 * float(wp.abs(dy)))
            total += share * values[at, _COEFFICIENTS + 3]
            mean += share * wp.vec3(
                values[at, _COEFFICIENTS], values[at, _COEFFICIENTS + 1], values[at, _COEFFICIENTS + 2]
            )
            for k in range(_COEFFICIENTS):
                coefficients[index, k] = coefficients[index, k] + share * values[at, k]
    scale = values[pixel, _COEFFICIENTS + 3] / total
    for k in range(_COEFFICIENTS):
        coefficients[index, k] = coefficients[index, k] * scale
    normal[index] = mean / wp.max(wp.length(mean), TINY)


@kernel
@no_type_check
def mean_over_surface(
    count: Ints,
    pixel: Longs,
    row: Ints,
    width: int,
    position: Vectors,
    normal: Vectors,
    off_plane_m: Floats,
    stride: int,
    lamp_radius_rad: Floats,
    before: Floats2,
    after: Floats2,
):
    """Fill `after` [R, C]: means of `before` over rays beside each on the same surface.

    The first columns are vectors of lamps of these radii; those of hard lamps stay (`smoothed_light`).
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    x = int(pixel[ray]) % width
    y = int(pixel[ray]) / width
    height = row.shape[0] / width
    columns = before.shape[1]
    total = float(_OF_ITSELF)
    for k in range(columns):
        after[ray, k] = _OF_ITSELF * before[ray, k]
    for near in range(9):
        dx = near % 3 - 1
        dy = near / 3 - 1
        there_x = x + stride * dx
        there_y = y + stride * dy
        if near == 4 or there_x < 0 or there_x >= width or there_y < 0 or there_y >= height:
            continue
        other = row[there_y * width + there_x]
        if other < 0:
            continue
        facing = wp.dot(normal[other], normal[ray])
        if facing <= 0.0:
            continue
        off = wp.dot(position[other] - position[ray], normal[ray]) / off_plane_m[0]
        share = float(_OF_SIDE)
        if dx * dy != 0:
            share = _OF_CORNER
        weight = share * wp.pow(facing, _FACING_POWER) * wp.exp(-off * off)
        total += weight
        for k in range(columns):
            after[ray, k] = after[ray, k] + weight * before[other, k]
    for k in range(columns):
        after[ray, k] = after[ray, k] / total
    for lamp in range(lamp_radius_rad.shape[0]):
        if 2.0 * lamp_radius_rad[lamp] < _HARD_RAD:
            for k in range(3):
                after[ray, 3 * lamp + k] = before[ray, 3 * lamp + k]
