"""Equals `tracing.trace` and the per-sample half of `field.PlaneField`: each ray followed front to back until opaque.

What lies behind the skin is never asked for: about half of the samples.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .planes import read_plane
from .rays import interval_list, placed
from .surface import closest_on_part, signed_height

_0, _1, _MM, _MIN_LENGTH = (np.float32(value) for value in (0, 1, 1000, 1e-12))
_TRANSPARENT = np.float32(1 / 1024)
"""A ray that lets less than this through is opaque: a quarter of one 8-bit level."""
_OPAQUE = np.float32(30)
_PRIOR_SLOPE, _PRIOR_OFFSET = np.float32(-6), np.float32(-1)


@compiled
def march(
    pixels,  # [R]
    directions,  # [R, 3]
    origin,  # [3]
    samples,  # N
    shell_m,
    focal_px,
    scale,  # of the posed hand against its template
    crossings,  # (depth [P, L], face [P, L], count [P], inner [P], scene [P]): `cpu.shell.Layers`
    surface,  # (shapes, spheres, neighbours, faces, vertices, normals): `cpu.shell.surface_arrays`
    corner_uv,  # [F, 3, 2]
    vertex_channels,  # [V, C]: normal 3, rotation 9, then local pose, then exposure
    pose_channels,
    table,  # flat texels of all planes; the last plane is the relief
    layout,  # [planes, 4]: start, resolution, heights, channels
    texels_m,  # [planes] size of a texel on the skin
    relief_gain,
    near_weight,  # [inputs, hidden], inputs padded with zeros to a multiple of 4
    near_bias,  # [hidden]
    density_weight,  # [hidden]
    density_bias,
    first,
    last,
    features,  # [R, K] out; zero at the start
    alpha,  # [R] out
    mean_depth,  # [R] out, m
):
    """Composite features, alpha and depth of rays [first, last)."""
    layer_depth, layer_face, count, inner, scene = crossings
    shapes, spheres, neighbours, faces, vertices, normals = surface
    layers = layer_depth.shape[1]
    start, end = np.empty(layers, np.float32), np.empty(layers, np.float32)
    part = np.empty(layers, np.int64)
    told = np.zeros(features.shape[1], np.float32)
    hidden = np.empty(len(near_bias), np.float32)
    channels = np.empty(vertex_channels.shape[1], np.float32)
    relief, scratch = np.empty(3, np.float32), np.empty(2 * np.max(layout[:, 3]), np.float32)
    near = near_weight.shape[0]
    for ray in range(first, last):
        pixel = pixels[ray]
        depths, marks, crossing_count = layer_depth[pixel], layer_face[pixel], count[pixel]
        intervals, total, stopped = interval_list(depths, marks, crossing_count, inner[pixel], scene[pixel], start, end)
        for crossing in range(crossing_count):
            part[crossing] = marks[crossing]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        step_mm = total / np.float32(samples) * length / scale * _MM
        through, weighted_depth = _1, _0
        for index in range(samples):
            offset = (np.float32(index) + np.float32(0.5)) / np.float32(samples) * total
            since, depth = placed(offset, start, end, intervals)
            x, y, z = origin[0] + depth * dx, origin[1] + depth * dy, origin[2] + depth * dz
            deepest, face, wb, wc = np.float32(np.inf), 0, _0, _0
            for crossing in range(crossing_count):
                if depths[crossing] > depth:
                    break
                if marks[crossing] < 0 or depths[crossing] < since:
                    continue
                found, b, c, squared = closest_on_part(x, y, z, part[crossing], shapes, spheres, neighbours)
                part[crossing] = found
                h = signed_height(x, y, z, found, b, c, squared, faces, vertices, normals)
                if h < deepest:
                    deepest, face, wb, wc = h, found, b, c
            height = deepest / scale / shell_m
            _read_sample(
                face,
                wb,
                wc,
                height,
                depth / (focal_px * scale),
                faces,
                corner_uv,
                vertex_channels,
                pose_channels,
                table,
                layout,
                texels_m,
                relief_gain,
                told,
                channels,
                relief,
                scratch,
            )
            logit = _logit(told, near, near_weight, near_bias, density_weight, density_bias, hidden)
            optical = softplus(logit + _PRIOR_SLOPE * height + _PRIOR_OFFSET) * step_mm
            if stopped and index == samples - 1:
                optical += _OPAQUE
            clear = np.exp(-optical)
            weight = through * (_1 - clear)
            for k in range(len(told)):
                features[ray, k] += weight * told[k]
            weighted_depth += weight * depth
            through *= clear
            if through < _TRANSPARENT:
                break
        alpha[ray] = _1 - through
        mean_depth[ray] = weighted_depth / max(_1 - through, np.float32(1e-6))


@compiled
def _read_sample(
    face,
    wb,
    wc,
    height,
    footprint_m,
    faces,
    corner_uv,
    vertex_channels,
    pose_channels,
    table,
    layout,
    texels_m,
    relief_gain,
    told,
    channels,
    relief,
    scratch,
):
    """Fill `told`: planes' features, height, its square, local pose, normal, relief normal, exposure."""
    wa = _1 - wb - wc
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    u = wa * corner_uv[face, 0, 0] + wb * corner_uv[face, 1, 0] + wc * corner_uv[face, 2, 0]
    v = wa * corner_uv[face, 0, 1] + wb * corner_uv[face, 1, 1] + wc * corner_uv[face, 2, 1]
    for k in range(len(channels)):
        channels[k] = wa * vertex_channels[a, k] + wb * vertex_channels[b, k] + wc * vertex_channels[c, k]
    at = 0
    planes = len(layout) - 1
    for plane in range(planes):
        begin, resolution, heights, width = layout[plane, 0], layout[plane, 1], layout[plane, 2], layout[plane, 3]
        fade = min(_1, np.float32(2) * texels_m[plane] / footprint_m)
        read_plane(table, begin, resolution, heights, width, u, v, height, fade, scratch, told, at)
        at += width
    told[at], told[at + 1] = height, height * height
    for k in range(pose_channels):
        told[at + 2 + k] = channels[12 + k]
    at += 2 + pose_channels
    fade = relief_gain * min(_1, np.float32(2) * texels_m[planes] / footprint_m)
    read_plane(table, layout[planes, 0], layout[planes, 1], 1, 3, u, v, height, fade, scratch, relief, 0)
    _normals(channels, relief, told, at)
    for k in range(len(channels) - 12 - pose_channels):
        told[at + 6 + k] = channels[12 + pose_channels + k]


@compiled
def _normals(channels, relief, told, at):
    """The posed normal, unit length, to told[at : at + 3], and after it the one with the relief's offset."""
    nx, ny, nz = _unit(channels[0], channels[1], channels[2])
    told[at], told[at + 1], told[at + 2] = nx, ny, nz
    rx = nx + channels[3] * relief[0] + channels[4] * relief[1] + channels[5] * relief[2]
    ry = ny + channels[6] * relief[0] + channels[7] * relief[1] + channels[8] * relief[2]
    rz = nz + channels[9] * relief[0] + channels[10] * relief[1] + channels[11] * relief[2]
    told[at + 3], told[at + 4], told[at + 5] = _unit(rx, ry, rz)


@compiled
def _unit(x, y, z):
    length = max(np.sqrt(x * x + y * y + z * z), _MIN_LENGTH)
    return x / length, y / length, z / length


@compiled
def _logit(told, near, near_weight, near_bias, density_weight, density_bias, hidden):
    """The density's layer: one hidden layer over the first `near` channels of `told`."""
    for j in range(len(hidden)):
        hidden[j] = near_bias[j]
    for i in range(0, near, 4):  # four at a time: `hidden` is read and written less often
        t0, t1, t2, t3 = told[i], told[i + 1], told[i + 2], told[i + 3]
        for j in range(len(hidden)):
            hidden[j] += (
                t0 * near_weight[i, j]
                + t1 * near_weight[i + 1, j]
                + t2 * near_weight[i + 2, j]
                + t3 * near_weight[i + 3, j]
            )
    logit = density_bias
    for j in range(len(hidden)):
        logit += max(hidden[j], _0) * density_weight[j]
    return logit


@compiled
def softplus(x):
    """log(1 + exp(x)) without overflow."""
    return max(x, _0) + np.log1p(np.exp(-abs(x)))
