"""A field of planes at the samples of rays, and their composite: as `field.field.PlaneField` and `field.volume`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....field.conditions import LOCAL_POSE_CHANNELS
from ....field.field import PRIOR_OFFSET, PRIOR_SLOPE, RELIEF_GAIN
from .compiled import Bools, Floats, Floats2, Floats3, Ints, Ints2, Longs, Longs2, Vectors, kernel, part

_TINY, _MIN_ALPHA, _OPAQUE = wp.constant(1e-12), wp.constant(1e-6), wp.constant(30.0)
_PRIOR_OFFSET, _PRIOR_SLOPE = wp.constant(PRIOR_OFFSET), wp.constant(PRIOR_SLOPE)
_RELIEF_GAIN, _POSE_CHANNELS = wp.constant(RELIEF_GAIN), wp.constant(LOCAL_POSE_CHANNELS)
_NORMAL, _ROTATION, _POSE = wp.constant(0), wp.constant(3), wp.constant(12)
START, RESOLUTION, HEIGHTS, CHANNELS = (wp.constant(value) for value in range(4))
"""Columns of a plane's row of the layout."""
SHELL_M, FOCAL_PX, SCALE = (wp.constant(value) for value in range(3))
"""What all rays share: half-width of the shell, template metres; focal length; of the posed hand to its template."""


@part
@no_type_check
def _cell(position: float, count: int) -> wp.vec2:
    """Find (first of the two texels about a position, share of the second), kept inside the grid."""
    place = wp.clamp(position, 0.0, float(count - 1))
    first = wp.max(wp.min(int(place), count - 2), 0)
    return wp.vec2(float(first), place - float(first))


@part
@no_type_check
def plane_value(
    table: Floats, start: int, texel: int, row: int, above: int, x: float, y: float, z: float, channel: int
) -> float:
    """Blend a channel between four texels, and between two layers of each."""
    value = wp.float32(0.0)
    for corner in range(8):
        weight = wp.where(corner % 2 == 1, x, 1.0 - x) * wp.where((corner / 2) % 2 == 1, y, 1.0 - y)
        weight *= wp.where(corner / 4 == 1, z, 1.0 - z)
        if weight > 0.0:
            at = start + (corner % 2) * texel + ((corner / 2) % 2) * row + (corner / 4) * above
            value += weight * table[at + channel]
    return value


@part
@no_type_check
def _unit(vector: wp.vec3) -> wp.vec3:
    return vector / wp.max(wp.length(vector), _TINY)


@part
@no_type_check
def _channel(values: Floats2, corners: wp.vec3i, weights: wp.vec3, channel: int) -> float:
    return (
        weights[0] * values[corners[0], channel]
        + weights[1] * values[corners[1], channel]
        + weights[2] * values[corners[2], channel]
    )


@part
@no_type_check
def _channels(values: Floats2, corners: wp.vec3i, weights: wp.vec3, first: int) -> wp.vec3:
    return wp.vec3(
        _channel(values, corners, weights, first),
        _channel(values, corners, weights, first + 1),
        _channel(values, corners, weights, first + 2),
    )


@kernel
@no_type_check
def gather_samples(
    count: Ints,
    face_of: Longs,
    weights_of: Vectors,
    height_of: Floats,
    t: Floats2,
    units: Floats,
    faces: Longs2,
    corner_uv: Floats3,
    vertex_channels: Floats2,
    table: Floats,
    layout: Ints2,
    texels_m: Floats,
    near_weight: Floats2,
    near_bias: Floats,
    density_weight: Floats2,
    density_bias: Floats,
    gathered: Floats2,
    sigma: Floats2,
):
    """Fill what samples [R, N] gather, [R * N, K], and their density per millimetre.

    Gathered are planes' features, height, height^2, local pose, normal, relief normal, light. `layout` [planes, 4] is
    of the flat `table`, the relief's plane last; `vertex_channels` are normal, rotation, local pose, light.
    """
    ray, index = wp.tid()
    if ray >= count[0]:
        return
    sample = ray * t.shape[1] + index
    face = int(face_of[sample])
    weights = weights_of[sample]
    corners = wp.vec3i(int(faces[face, 0]), int(faces[face, 1]), int(faces[face, 2]))
    u = wp.float32(0.0)
    v = wp.float32(0.0)
    for corner in range(3):
        u += weights[corner] * corner_uv[face, corner, 0]
        v += weights[corner] * corner_uv[face, corner, 1]
    height = height_of[sample] / units[SHELL_M]
    footprint_m = t[ray, index] / (units[FOCAL_PX] * units[SCALE])
    planes = layout.shape[0] - 1
    at = wp.int32(0)
    relief = wp.vec3()
    for plane in range(planes + 1):
        resolution = layout[plane, RESOLUTION]
        heights = layout[plane, HEIGHTS]
        texel = heights * layout[plane, CHANNELS]
        across = _cell(u * float(resolution) - 0.5, resolution)
        down = _cell(v * float(resolution) - 0.5, resolution)
        layer = wp.vec2()
        above = wp.int32(0)
        if heights > 1:
            layer = _cell((height + 1.0) * float(heights - 1) / 2.0, heights)
            above = layout[plane, CHANNELS]
        start = layout[plane, START] + (int(down[0]) * resolution + int(across[0])) * texel + int(layer[0]) * above
        fade = wp.min(2.0 * texels_m[plane] / footprint_m, 1.0)
        for channel in range(layout[plane, CHANNELS]):
            value = fade * plane_value(
                table, start, texel, resolution * texel, above, across[1], down[1], layer[1], channel
            )
            if plane < planes:
                gathered[sample, at] = value
                at += 1
            else:
                relief[channel] = value * _RELIEF_GAIN
    gathered[sample, at] = height
    gathered[sample, at + 1] = height * height
    for channel in range(_POSE_CHANNELS):
        gathered[sample, at + 2 + channel] = _channel(vertex_channels, corners, weights, _POSE + channel)
    at += 2 + _POSE_CHANNELS
    normal = _unit(_channels(vertex_channels, corners, weights, _NORMAL))
    turned = wp.vec3()
    for axis in range(3):
        turned[axis] = wp.dot(_channels(vertex_channels, corners, weights, _ROTATION + 3 * axis), relief)
    bent = _unit(normal + turned)
    for axis in range(3):
        gathered[sample, at + axis] = normal[axis]
        gathered[sample, at + 3 + axis] = bent[axis]
    first_light = _POSE + _POSE_CHANNELS
    for channel in range(first_light, vertex_channels.shape[1]):
        gathered[sample, at + 6 + channel - first_light] = _channel(vertex_channels, corners, weights, channel)
    logit = density_bias[0] + _PRIOR_SLOPE * height + _PRIOR_OFFSET
    for hidden in range(near_bias.shape[0]):
        total = wp.float32(near_bias[hidden])
        for k in range(near_weight.shape[1]):
            total += near_weight[hidden, k] * gathered[sample, k]
        logit += wp.max(total, 0.0) * density_weight[0, hidden]
    sigma[ray, index] = wp.max(logit, 0.0) + wp.log(1.0 + wp.exp(-wp.abs(logit)))


@kernel
@no_type_check
def weigh_samples(
    count: Ints,
    sigma: Floats2,
    t: Floats2,
    dt: Floats,
    directions: Vectors,
    is_stopped: Bools,
    units: Floats,
    transparent: float,
    alpha: Floats,
    depth: Floats,
    weights: Floats2,
):
    """Fill what samples [R, N] contribute to their rays, and the rays' alpha and mean depth, m.

    Where less light is left than `transparent`, a ray ends; if it is to end opaque, its samples then count for all.
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    step_mm = dt[ray] * wp.length(directions[ray]) / units[SCALE] * 1000.0
    samples = sigma.shape[1]
    before = wp.float32(0.0)
    total = wp.float32(0.0)
    mean = wp.float32(0.0)
    for index in range(samples):
        optical_depth = sigma[ray, index] * step_mm
        if is_stopped[ray] and index == samples - 1:
            optical_depth += _OPAQUE
        weight = wp.float32(0.0)
        through = wp.exp(-before)
        if through >= transparent:
            weight = through * (1.0 - wp.exp(-optical_depth))
        weights[ray, index] = weight
        total += weight
        mean += weight * t[ray, index]
        before += optical_depth
    depth[ray] = mean / wp.max(total, _MIN_ALPHA)
    if transparent > 0.0 and is_stopped[ray]:
        for index in range(samples):
            weights[ray, index] = weights[ray, index] / total
        total = wp.float32(1.0)
    alpha[ray] = total


@kernel
@no_type_check
def sum_samples(count: Ints, gathered: Floats2, weights: Floats2, channels: Floats2):
    """Fill the composited features [R, K] of rays."""
    ray, channel = wp.tid()
    if ray >= count[0]:
        return
    samples = weights.shape[1]
    total = wp.float32(0.0)
    for index in range(samples):
        total += weights[ray, index] * gathered[ray * samples + index, channel]
    channels[ray, channel] = total
