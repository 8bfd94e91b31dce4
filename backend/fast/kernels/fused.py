"""Equals `tracing.trace` and the per-sample half of `field.PlaneField`: each ray followed front to back until opaque.

What lies behind the skin is never asked for: about half of the samples.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .planes import read_plane
from .rays import begin_ray, deepest_part, placed, point_at, ray_buffers

_0, _HALF, _1, _2, _MM, _MIN_LENGTH, _MIN_ALPHA = (np.float32(value) for value in (0, 0.5, 1, 2, 1000, 1e-12, 1e-6))
_TRANSPARENT = np.float32(1 / 256)
"""A ray that lets less than this through is opaque: one 8-bit level."""
_OPAQUE = np.float32(30)
NORMAL, ROTATION, POSE = 0, 3, 12
"""Where these begin among the vertices' channels."""


@compiled
def march(
    pixels,  # [R]
    directions,  # [R, 3]
    origin,  # [3]
    layers,  # `cpu.shell.Layers`
    surface,  # `cpu.shell.surface_arrays`
    skin,  # (corner_uv [F, 3, 2], channels [V, C]: normal 3, rotation 9, local pose, exposure)
    field,  # `cpu.marching.PackedField`
    units,  # (samples per ray, shell m, focal length px, scale of the posed hand against its template)
    first,
    last,
    features,  # [R, K] out; zero at the start
    alpha,  # [R] out
    mean_depth,  # [R] out, m
    weights,  # [R, N] out; zero at the start, and behind where a ray has become opaque
    t,  # [R, N] out, m; as it was, there
    dt,  # [R] out, m
):
    """Composite the features, alpha and depth of rays [first, last)."""
    samples, shell_m, focal_px, scale = units
    start, end, part = ray_buffers(layers)
    tried = np.empty((3, surface[1].shape[2]), np.float32)
    told, channels = np.zeros(features.shape[1], np.float32), np.empty(skin[1].shape[1], np.float32)
    relief, hidden = np.empty(4, np.float32), np.empty(len(field[5]), np.float32)
    for ray in range(first, last):
        intervals, total, is_stopped = begin_ray(pixels[ray], layers, start, end, part)
        dt[ray] = total / np.float32(samples)
        step_mm = dt[ray] * _length(directions, ray) / scale * _MM
        through, weighted_depth = _1, _0
        for index in range(samples):
            offset = (np.float32(index) + _HALF) / np.float32(samples) * total
            since, depth = placed(offset, start, end, intervals)
            x, y, z = point_at(origin, directions, ray, depth)
            face, wb, wc, height = deepest_part(x, y, z, depth, since, pixels[ray], layers, surface, part, tried)
            height /= scale * shell_m
            _tell(face, wb, wc, height, depth / (focal_px * scale), surface[3], skin, field, told, channels, relief)
            optical = _density(height, told, field, hidden) * step_mm
            if is_stopped and index == samples - 1:
                optical += _OPAQUE
            clear = np.exp(-optical)
            weight = through * (_1 - clear)
            weights[ray, index], t[ray, index] = weight, depth
            for k in range(len(told)):
                features[ray, k] += weight * told[k]
            weighted_depth += weight * depth
            through *= clear
            if through < _TRANSPARENT:
                break
        mean_depth[ray] = weighted_depth / max(_1 - through, _MIN_ALPHA)
        alpha[ray] = _1 - through
        if is_stopped:  # opaque in the end, also where the march has stopped before
            alpha[ray] = _1
            for k in range(len(told)):
                features[ray, k] /= _1 - through
            for index in range(samples):
                weights[ray, index] /= _1 - through


@compiled
def _tell(face, wb, wc, height, footprint_m, faces, skin, field, told, channels, relief):
    """Fill `told`: planes' features, height, its square, local pose, normal, relief normal, exposure."""
    corner_uv, vertex_channels = skin
    table, layout, texels_m, relief_gain, pose_channels = field[0], field[1], field[2], field[3], field[4]
    wa = _1 - wb - wc
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    u = wa * corner_uv[face, 0, 0] + wb * corner_uv[face, 1, 0] + wc * corner_uv[face, 2, 0]
    v = wa * corner_uv[face, 0, 1] + wb * corner_uv[face, 1, 1] + wc * corner_uv[face, 2, 1]
    for k in range(len(channels)):
        channels[k] = wa * vertex_channels[a, k] + wb * vertex_channels[b, k] + wc * vertex_channels[c, k]
    at, planes = 0, len(layout) - 1
    for plane in range(planes):
        begin, resolution, heights, width = layout[plane, 0], layout[plane, 1], layout[plane, 2], layout[plane, 3]
        fade = min(_1, _2 * texels_m[plane] / footprint_m)
        read_plane(table, begin, resolution, heights, width, u, v, height, fade, told, at)
        at += layout[plane, 4]  # what is told next covers the padding
    told[at], told[at + 1] = height, height * height
    for k in range(pose_channels):
        told[at + 2 + k] = channels[POSE + k]
    at += 2 + pose_channels
    fade = relief_gain * min(_1, _2 * texels_m[planes] / footprint_m)
    read_plane(table, layout[planes, 0], layout[planes, 1], 1, layout[planes, 3], u, v, height, fade, relief, 0)
    tell_normals(channels, relief, told, at)
    for k in range(len(channels) - POSE - pose_channels):
        told[at + 6 + k] = channels[POSE + pose_channels + k]


@compiled
def tell_normals(channels, relief, told, at):
    """The posed normal, unit length, to told[at : at + 3], and after it the one with the relief's offset."""
    nx, ny, nz = _unit(channels[NORMAL], channels[NORMAL + 1], channels[NORMAL + 2])
    told[at], told[at + 1], told[at + 2] = nx, ny, nz
    x, y, z = _turned(channels, relief)
    told[at + 3], told[at + 4], told[at + 5] = _unit(nx + x, ny + y, nz + z)


@compiled
def _turned(channels, offset):
    """An offset in the canonical hand's axes, turned into the world."""
    r, x, y, z = ROTATION, offset[0], offset[1], offset[2]
    turned_x = channels[r] * x + channels[r + 1] * y + channels[r + 2] * z
    turned_y = channels[r + 3] * x + channels[r + 4] * y + channels[r + 5] * z
    turned_z = channels[r + 6] * x + channels[r + 7] * y + channels[r + 8] * z
    return turned_x, turned_y, turned_z


@compiled
def _unit(x, y, z):
    length = max(np.sqrt(x * x + y * y + z * z), _MIN_LENGTH)
    return x / length, y / length, z / length


@compiled
def _length(directions, ray):
    x, y, z = directions[ray, 0], directions[ray, 1], directions[ray, 2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
def _density(height, told, field, hidden):
    """Density per mm: one hidden layer over the first channels of `told`, and the prior."""
    near_bias, near_weight, density_weight, density_bias, slope, prior = field[5:]
    for j in range(len(hidden)):
        hidden[j] = near_bias[j]
    for i in range(0, near_weight.shape[0], 4):  # four at a time: `hidden` is read and written less often
        t0, t1, t2, t3 = told[i], told[i + 1], told[i + 2], told[i + 3]
        for j in range(len(hidden)):
            hidden[j] += (
                t0 * near_weight[i, j]
                + t1 * near_weight[i + 1, j]
                + t2 * near_weight[i + 2, j]
                + t3 * near_weight[i + 3, j]
            )
    logit = density_bias + slope * height + prior
    for j in range(len(hidden)):
        logit += max(hidden[j], _0) * density_weight[j]
    return max(logit, _0) + np.log1p(np.exp(-abs(logit)))
