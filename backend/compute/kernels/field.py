"""Rays through a field of planes, traced, queried and composited at once, without gradients.

As `field.surface_tracking.trace`, `field.encoding.FeaturePlane` and the per-sample half of `field.field.PlaneField`.
Each ray is followed front to back until it is opaque, so that samples behind the skin are never queried: about half.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.tolerances import TRANSPARENT
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .rays import begin_ray, deepest_part, point_at, put_sample
from .vectors import LANES, blend_texels, window_sums

_0, _HALF, _1, _2, _MM, _MIN_LENGTH, _MIN_ALPHA = (np.float32(value) for value in (0, 0.5, 1, 2, 1000, 1e-12, 1e-6))
BLOCK = 4
"""Channels of planes are read in blocks of this many, which fit one register."""
_TRANSPARENT = np.float32(TRANSPARENT)
_OPAQUE = np.float32(30)
NORMAL, ROTATION, POSE = 0, 3, 12
"""Where these begin among the vertices' channels."""
DENSITY_BLOCK = 2 * LANES
"""Hidden values of the density are a multiple of this."""


class Skin(NamedTuple):
    """Values on the surface: corner_uv [F, 3, 2]; channels [V, C]: normal 3, rotation 9, local pose, light."""

    corner_uv: np.ndarray
    channels: np.ndarray


class RayUnits(NamedTuple):
    """What all rays share.

    Attributes:
        samples: per ray.
        shell_m: half-width of the shell.
        focal_px: focal length; px per m of an orthographic camera.
        scale: of the posed hand to its template.
        is_orthographic: whether pixels are as wide at every depth.
    """

    samples: int
    shell_m: np.float32
    focal_px: np.float32
    scale: np.float32
    is_orthographic: bool


class PackedField(NamedTuple):
    """Tables and weights of a field of planes.

    Attributes:
        table: flat texels of all planes, the relief's last, channels padded to whole blocks; fp32, or the bits of half
            precision.
        layout: [planes, 5] start in the table, resolution, heights, channels with padding, channels without.
        texels_m: [planes] size of a texel on the skin.
        relief_gain: factor of the relief.
        pose_channels: of the local pose.
        near_bias: [hidden], padded with zeros to whole blocks.
        near_weight: [1, inputs, hidden].
        density_weight: [hidden].
        density_bias: of the density.
        slope: of the density's prior over height.
        prior: its offset.
    """

    table: np.ndarray
    layout: np.ndarray
    texels_m: np.ndarray
    relief_gain: np.float32
    pose_channels: int
    near_bias: np.ndarray
    near_weight: np.ndarray
    density_weight: np.ndarray
    density_bias: np.float32
    slope: np.float32
    prior: np.float32


class RayBuffers(NamedTuple):
    """What the samples of one ray are computed in.

    Attributes:
        start: [L] of its intervals, m.
        end: [L] m.
        since: [L] depth at which it enters the shell there, m.
        part: [L] the current face of each part that it has entered.
        tried: [3, K] distances^2 and weights of the faces around.
        gathered: [features].
        channels: [C] of the skin.
        relief: [4].
        hidden: [hidden] of the density.
    """

    start: np.ndarray
    end: np.ndarray
    since: np.ndarray
    part: np.ndarray
    tried: np.ndarray
    gathered: np.ndarray
    channels: np.ndarray
    relief: np.ndarray
    hidden: np.ndarray


class RayOutputs(NamedTuple):
    """What rendered rays are written to; features and weights are zero at the start.

    Attributes:
        features: [R, K] composited gathered features.
        alpha: [R].
        depth: [R] mean depth, m.
        weights: [R, N] zero behind the sample at which a ray becomes opaque.
        t: [R, N] depth of each sample, m; not written behind that sample.
        dt: [R] m.
    """

    features: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    weights: np.ndarray
    t: np.ndarray
    dt: np.ndarray


@compiled
def render_rays(rays, crossings, surface, skin, field, units, first, last, out):
    """Composite the gathered features, alpha and depth of rays [first, last) into `out` (`RayOutputs`)."""
    capacity = crossings.depth.shape[1]
    buffers = RayBuffers(
        np.empty(capacity, np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.int64),
        np.empty((3, surface.around.shape[2]), np.float32),
        np.zeros(out.features.shape[1], np.float32),
        np.empty(skin.channels.shape[1], np.float32),
        np.empty(4, np.float32),
        np.empty(len(field.near_bias), np.float32),
    )
    for ray in range(first, last):
        _render_ray(ray, rays, crossings, surface, skin, field, units, buffers, out)


@part
def _render_ray(ray, rays, crossings, surface, skin, field, units, buffers, out):
    samples, scale = units.samples, units.scale
    start, end, since, current, gathered = buffers.start, buffers.end, buffers.since, buffers.part, buffers.gathered
    pixel = rays.pixel[ray]
    intervals, total, is_stopped = begin_ray(pixel, crossings, start, end, since, current)
    out.dt[ray] = total / np.float32(samples)
    step_mm = out.dt[ray] * _length(rays.directions, ray) / scale * _MM
    transmittance, weighted_depth = _1, _0
    for index in range(samples):
        offset = (np.float32(index) + _HALF) / np.float32(samples) * total
        interval, depth = put_sample(offset, start, end, intervals)
        x, y, z = point_at(rays, ray, depth)
        face, wb, wc, height = deepest_part(
            x, y, z, depth, since[interval], pixel, crossings, surface, current, buffers.tried
        )
        height /= scale * units.shell_m
        footprint_m = (_1 if units.is_orthographic else depth) / (units.focal_px * scale)
        _gather(face, wb, wc, height, footprint_m, surface.faces, skin, field, buffers)
        optical_depth = _density(height, gathered, field, buffers.hidden) * step_mm
        if is_stopped and index == samples - 1:
            optical_depth += _OPAQUE
        clear = np.exp(-optical_depth)
        weight = transmittance * (_1 - clear)
        out.weights[ray, index], out.t[ray, index] = weight, depth
        for k in range(len(gathered)):
            out.features[ray, k] += weight * gathered[k]
        weighted_depth += weight * depth
        transmittance *= clear
        if transmittance < _TRANSPARENT:
            break
    out.depth[ray] = weighted_depth / max(_1 - transmittance, _MIN_ALPHA)
    out.alpha[ray] = _1 - transmittance
    if is_stopped:  # the ray ends opaque, even if the loop has stopped early
        out.alpha[ray] = _1
        for k in range(len(gathered)):
            out.features[ray, k] /= _1 - transmittance
        for index in range(samples):
            out.weights[ray, index] /= _1 - transmittance


@part
def _gather(face, wb, wc, height, footprint_m, faces, skin, field, buffers):
    """Fill `gathered`: planes' features, height, height^2, local pose, normal, relief normal, light."""
    gathered, channels, relief = buffers.gathered, buffers.channels, buffers.relief
    wa, corner_uv, vertex_channels = _1 - wb - wc, skin.corner_uv, skin.channels
    layout, texels_m = field.layout, field.texels_m
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    u = wa * corner_uv[face, 0, 0] + wb * corner_uv[face, 1, 0] + wc * corner_uv[face, 2, 0]
    v = wa * corner_uv[face, 0, 1] + wb * corner_uv[face, 1, 1] + wc * corner_uv[face, 2, 1]
    for k in range(len(channels)):
        channels[k] = wa * vertex_channels[a, k] + wb * vertex_channels[b, k] + wc * vertex_channels[c, k]
    at, planes = 0, len(layout) - 1
    for plane in range(planes):
        begin, resolution, heights, width = layout[plane, 0], layout[plane, 1], layout[plane, 2], layout[plane, 3]
        fade = min(_1, _2 * texels_m[plane] / footprint_m)
        read_plane(field.table, begin, resolution, heights, width, u, v, height, fade, gathered, at)
        at += layout[plane, 4]  # the next values overwrite the padding
    gathered[at], gathered[at + 1] = height, height * height
    for k in range(field.pose_channels):
        gathered[at + 2 + k] = channels[POSE + k]
    at += 2 + field.pose_channels
    fade = field.relief_gain * min(_1, _2 * texels_m[planes] / footprint_m)
    start, resolution, width = layout[planes, 0], layout[planes, 1], layout[planes, 3]
    read_plane(field.table, start, resolution, 1, width, u, v, height, fade, relief, 0)
    write_normals(channels, relief, gathered, at)
    for k in range(len(channels) - POSE - field.pose_channels):
        gathered[at + 6 + k] = channels[POSE + field.pose_channels + k]


@part
def write_normals(channels, relief, out, at):
    """Write the unit posed normal to out[at : at + 3], and after it the unit normal with the relief's offset."""
    nx, ny, nz = _unit(channels[NORMAL], channels[NORMAL + 1], channels[NORMAL + 2])
    out[at], out[at + 1], out[at + 2] = nx, ny, nz
    x, y, z = _to_world(channels, relief)
    out[at + 3], out[at + 4], out[at + 5] = _unit(nx + x, ny + y, nz + z)


@part
def _to_world(channels, offset):
    """Rotate an offset in the canonical hand's axes into the world."""
    r, x, y, z = ROTATION, offset[0], offset[1], offset[2]
    world_x = channels[r] * x + channels[r + 1] * y + channels[r + 2] * z
    world_y = channels[r + 3] * x + channels[r + 4] * y + channels[r + 5] * z
    world_z = channels[r + 6] * x + channels[r + 7] * y + channels[r + 8] * z
    return world_x, world_y, world_z


@part
def _unit(x, y, z):
    length = max(np.sqrt(x * x + y * y + z * z), _MIN_LENGTH)
    return x / length, y / length, z / length


@part
def _length(directions, ray):
    x, y, z = directions[ray, 0], directions[ray, 1], directions[ray, 2]
    return np.sqrt(x * x + y * y + z * z)


@part
def _density(height, gathered, field, hidden):
    """Compute density per mm: one hidden layer over the first gathered features, and the prior."""
    for start in range(0, len(hidden), DENSITY_BLOCK):
        window_sums(1, 1, 2, gathered, 0, 0, 0, field.near_weight[:, :, start:], hidden[start:])
    logit = field.density_bias + field.slope * height + field.prior
    for j in range(len(hidden)):
        logit += max(hidden[j] + field.near_bias[j], _0) * field.density_weight[j]
    return max(logit, _0) + np.log1p(np.exp(-abs(logit)))


@part
def read_plane(table, start, resolution, heights, channels, u, v, height, fade, out, at):
    """Write the plane's features, times `fade`, to out[at : at + channels], channels a multiple of BLOCK.

    Its texels lie in the flat `table`, of fp32 or of half precision, from `start`: row-major over v, u, height layer,
    channel.
    """
    cell, fx, fy, share = plane_cell(u, v, height, (resolution, heights, channels))
    low, high = fade * (_1 - fy), fade * fy
    weights = (_1 - fx) * low, fx * low, (_1 - fx) * high, fx * high
    texel = np.intp(heights * channels)
    row, above = resolution * texel, np.intp(channels) if heights > 1 else np.intp(0)
    for done in range(0, channels, BLOCK):
        blend_texels(table, np.intp(start) + np.intp(cell) + done, texel, row, above, weights, share, out, at + done)


@part
def texel_at(position, count):
    """Find (first of the two texels about a position, share of the second), kept inside the grid, NaN too."""
    position = min(max(position, _0), np.float32(count - 1))
    first = max(min(int(position), count - 2), 0)
    return first, position - np.float32(first)


@part
def plane_cell(u, v, height, sizes):
    """Find (where the first corner's features begin in the flat table, shares of the next in u, in v and in height)."""
    resolution, heights, channels = sizes
    x, fx = texel_at(u * np.float32(resolution) - _HALF, resolution)
    y, fy = texel_at(v * np.float32(resolution) - _HALF, resolution)
    layer, share = 0, _0 * height
    if heights > 1:
        layer, share = texel_at((height + _1) * np.float32(heights - 1) / _2, heights)
    return np.uintp(((y * resolution + x) * heights + layer) * channels), fx, fy, share
