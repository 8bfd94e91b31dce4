"""Layers of a field's decoder, a few rays at a time, and what a relightable one is given."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .vectors import LANES, window_sums

BLOCK = 6
"""Rays that are decoded at once."""
GROUP = 4 * LANES
"""Outputs of a layer that are computed at once; every layer has a multiple of these."""
LAST_GROUP = GROUP // 2
"""The same of the last layer, which has few."""
_GROUP, _LANES = np.uintp(GROUP), np.uintp(LANES)
_0, _1, _HALF, _TINY = (np.float32(value) for value in (0, 1, 0.5, 1e-12))


@compiled
def decode_rays(inputs, one, two, three, steps, first, last, out):
    """Fill out [R, outputs] for the inputs [R, C] of rays [first, last).

    Layers are (weights [groups, 1, C, GROUP], factors [groups * GROUP], bias [groups * GROUP]). `steps` is an empty
    fp32 array, or one uint8: the steps to which a ray's values are rounded for the second layer, whose weights are then
    int32, four int8 each.
    """
    width, columns, item = len(one[2]), inputs.shape[1], steps.itemsize
    block, hidden = np.zeros((BLOCK, columns), np.float32), np.empty((BLOCK, width), np.float32)
    source, scale = np.empty((BLOCK, width), steps.dtype), np.ones(BLOCK, np.float32)
    sums, of_source = np.empty((BLOCK, GROUP), np.float32), np.empty((BLOCK, GROUP), two[0].dtype)
    last_sums = np.empty((BLOCK, LAST_GROUP), np.float32)
    unscaled, lanes = np.ones(BLOCK, np.float32), np.empty(LANES, np.float32)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        block[:count] = inputs[start : start + count]
        for group in range(len(one[0])):
            window_sums(1, 6, 4, block, 0, 4 * columns, 0, one[0][group], sums)
            _activate(sums, unscaled, one[1], one[2], group, hidden)
        _load(hidden, steps, scale, lanes, source)
        for group in range(len(two[0])):
            window_sums(1, 6, 4, source, 0, item * width, 0, two[0][group], of_source)
            _activate(of_source, scale, two[1], two[2], group, hidden)
        for begin in range(0, out.shape[1], LAST_GROUP):
            window_sums(1, 6, 2, hidden, 0, 4 * width, 0, three[0][begin // GROUP, :, :, begin % GROUP :], last_sums)
            for ray in range(count):
                for column in range(min(LAST_GROUP, out.shape[1] - begin)):
                    out[start + ray, begin + column] = last_sums[ray, column] + three[2][begin + column]


@compiled
def decoder_inputs(channels, alpha, view, share, towards, normal, relief, least_alpha, first, last, out):
    """Fill out [R, C] for rays [first, last) as `field.relightable.LitField.decoder_inputs`.

    Args:
        channels: [R, K] gathered; the first of them are the decoder's.
        alpha: [R].
        view: [R, 3] unit, from the camera.
        share: [R] of the sky that is open.
        towards: [R, 3] unit, the open side.
        normal: where the mesh's normal begins among the channels, after the decoder's.
        relief: where that with relief begins.
        least_alpha: by which channels are divided at least.
        first: ray.
        last: ray.
        out: channels near the skin and seven angles.
    """
    for ray in range(first, last):
        inverse = _1 / max(alpha[ray], least_alpha)
        for k in range(normal):
            out[ray, k] = channels[ray, k] * inverse
        nx, ny, nz = _unit(channels, ray, normal)
        rx, ry, rz = _unit(channels, ray, relief)
        vx, vy, vz = view[ray, 0], view[ray, 1], view[ray, 2]
        ox, oy, oz = towards[ray, 0], towards[ray, 1], towards[ray, 2]
        facing = -(rx * vx + ry * vy + rz * vz)
        away = _1 - min(max(facing, _0), _1)
        out[ray, normal], out[ray, normal + 1] = -(nx * vx + ny * vy + nz * vz), facing
        out[ray, normal + 2] = away * away * away * away * away
        out[ray, normal + 3], out[ray, normal + 4] = nx * rx + ny * ry + nz * rz, share[ray]
        out[ray, normal + 5], out[ray, normal + 6] = ox * rx + oy * ry + oz * rz, -(ox * vx + oy * vy + oz * vz)


@part
def _unit(values, row, at):
    """Three values of a row, of length 1, or zero."""
    x, y, z = values[row, at], values[row, at + 1], values[row, at + 2]
    inverse = _1 / max(np.sqrt(x * x + y * y + z * z), _TINY)
    return x * inverse, y * inverse, z * inverse


@part
def _activate(sums, scale, factors, bias, group, hidden):
    begin = np.uintp(group * GROUP)  # unsigned, as numba lets signed indices count from the end
    for ray in range(BLOCK):
        gain = scale[ray]
        for column in range(_GROUP):
            value = np.float32(sums[ray, column]) * (gain * factors[begin + column]) + bias[begin + column]
            hidden[ray, begin + column] = max(value, _0)


@part
def _load(hidden, steps, scale, lanes, source):
    """Copy values, none of them negative; round them, where there are steps, and fill each ray's scale."""
    width = np.uintp(hidden.shape[1])
    for ray in range(BLOCK):
        inverse, offset = _1, _0
        if len(steps):
            for lane in range(_LANES):
                lanes[lane] = _TINY
            for start in range(np.uintp(0), width, _LANES):
                for lane in range(_LANES):
                    lanes[lane] = max(lanes[lane], hidden[ray, start + lane])
            most = _TINY
            for lane in range(_LANES):
                most = max(most, lanes[lane])
            scale[ray] = most / np.float32(steps[0])
            inverse, offset = _1 / scale[ray], _HALF
        for column in range(width):
            source[ray, column] = hidden[ray, column] * inverse + offset
