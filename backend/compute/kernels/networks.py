"""Layers of networks in vector registers: a field's decoder, and super-resolution's 3 x 3 convolutions.

Convolutions run over runs of pixels, one a row, instead of the whole image. Images are
[1 + h + 1, 1 + w + 1 + `SPARE`, C], their border zero: of fp32, or of uint8 that stand for scale * (value - zero).
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .vectors import LANES, window_sums

BLOCK = 6
"""Rays that are decoded, or pixels that are computed, at once."""
GROUP = 4 * LANES
"""Outputs of a layer that are computed at once; every layer has a multiple of these."""
MIDDLE = 128
"""Of 256 steps: what stands for 0 where values have either sign."""
LAST_GROUP = GROUP // 2
"""The same of the last layer, which has few."""
_GROUP, _LANES = np.uintp(GROUP), np.uintp(LANES)
DILATION = 2
"""Pixels beside the hand that are computed too: the network softens its edges."""
SPARE = BLOCK
"""Pixels to the right of the border, which the last block of a row may read."""
CHANNELS = 32, 48, 64
"""Of hidden layers: two, three or four vectors; of the last layer, at most."""
SLOPE = 0.2
_SLOPE, _0, _1, _HALF, _TINY, _MOST = (np.float32(value) for value in (SLOPE, 0, 1, 0.5, 1e-12, 255))


@compiled
def decode_rays(inputs, gains, one, two, three, steps, first, last, out):
    """Fill out [R, outputs] for the inputs [R, C] of rays [first, last), times gains [C].

    Layers are (weights [groups, 1, C, GROUP], and of [groups * GROUP] factors, bias, and what sums have too much).
    `steps` is an empty fp32 array, or one uint8: the steps to which a ray's values are rounded for every layer, whose
    weights are then int32, four int8 each; the inputs are counted from `MIDDLE`.
    """
    width, columns, item = len(one[2]), one[0].shape[2] * (4 // steps.itemsize), steps.itemsize
    values = np.zeros((BLOCK, (columns + LANES - 1) // LANES * LANES), np.float32)
    hidden = np.empty((BLOCK, width), np.float32)
    block, source = np.zeros((BLOCK, columns), steps.dtype), np.empty((BLOCK, width), steps.dtype)
    sums, last_sums = np.empty((BLOCK, GROUP), one[0].dtype), np.empty((BLOCK, LAST_GROUP), one[0].dtype)
    scale, lanes = np.ones(BLOCK, np.float32), np.empty(LANES, np.float32)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        for pixel in range(count):
            for column in range(inputs.shape[1]):
                values[pixel, column] = inputs[start + pixel, column] * gains[column]
        _load(values, MIDDLE, steps, scale, lanes, block)
        for group in range(len(one[0])):
            window_sums(1, 6, 4, block, 0, item * columns, 0, one[0][group], sums)
            _activate(sums, scale, one, group, hidden)
        _load(hidden, 0, steps, scale, lanes, source)
        for group in range(len(two[0])):
            window_sums(1, 6, 4, source, 0, item * width, 0, two[0][group], sums)
            _activate(sums, scale, two, group, hidden)
        _load(hidden, 0, steps, scale, lanes, source)
        for begin in range(0, out.shape[1], LAST_GROUP):
            weights = three[0][begin // GROUP, :, :, begin % GROUP :]
            window_sums(1, 6, 2, source, 0, item * width, 0, weights, last_sums)
            for ray in range(count):
                for column in range(min(LAST_GROUP, out.shape[1] - begin)):
                    gain = scale[ray] * three[1][begin + column]
                    out[start + ray, begin + column] = last_sums[ray, column] * gain + three[2][begin + column]


@compiled
def decoder_inputs(channels, alpha, view, share, towards, normal, relief, least_alpha, first, last, out):
    """Fill out [R, C] for rays [first, last) as `field.relightable.RelightableField.decoder_inputs`.

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
    """Return three values of a row, of length 1, or zero."""
    x, y, z = values[row, at], values[row, at + 1], values[row, at + 2]
    inverse = _1 / max(np.sqrt(x * x + y * y + z * z), _TINY)
    return x * inverse, y * inverse, z * inverse


@part
def _activate(sums, scale, layer, group, hidden):
    begin = np.uintp(group * GROUP)  # unsigned, as numba lets signed indices count from the end
    factors, bias, zeros = layer[1], layer[2], layer[3]
    for ray in range(BLOCK):
        gain = scale[ray]
        for column in range(_GROUP):
            at = begin + column
            value = np.float32(sums[ray, column] - zeros[at]) * (gain * factors[at]) + bias[at]
            hidden[ray, at] = max(value, _0)


@part
def _load(values, middle, steps, scale, lanes, source):
    """Copy as many values as the source takes; count them from a middle, where there are steps, and fill the scale."""
    width = np.uintp(values.shape[1])
    for ray in range(BLOCK):
        inverse, offset = _1, _0
        if len(steps):
            for lane in range(_LANES):
                lanes[lane] = _TINY
            for start in range(np.uintp(0), width, _LANES):
                for lane in range(_LANES):
                    lanes[lane] = max(lanes[lane], abs(values[ray, start + lane]))
            most = _TINY
            for lane in range(_LANES):
                most = max(most, lanes[lane])
            scale[ray] = most / np.float32(steps[0] - middle)
            inverse, offset = _1 / scale[ray], np.float32(middle) + _HALF
        for column in range(np.uintp(source.shape[1])):
            source[ray, column] = values[ray, column] * inverse + offset


@compiled
def find_runs(alpha, runs):
    """Fill runs [h, 2], the first live pixel of a row (alpha > 0) and the one after the last, both dilated."""
    height, width = alpha.shape
    own = np.zeros((height, 2), np.int64)
    for y in range(height):
        own[y, 0] = width
        for x in range(width):
            if alpha[y, x] > 0:
                own[y, 0], own[y, 1] = min(own[y, 0], x), x + 1
    for y in range(height):
        first, last = width, 0
        for near in range(max(0, y - DILATION), min(height, y + DILATION + 1)):
            if own[near, 0] < own[near, 1]:
                first, last = min(first, own[near, 0] - DILATION), max(last, own[near, 1] + DILATION)
        runs[y, 0], runs[y, 1] = max(first, 0), min(last, width)
        if first >= last:
            runs[y] = 0


@compiled
def fill_around(runs, values, border, first, last, image):
    """Give the pixels of rows [first, last) of the padded image that windows of runs read the values [C] of nothing.

    Those of runs themselves are left to whoever computes them.
    """
    height, width = len(runs), image.shape[1] - 2 - SPARE
    for row in range(first, last):
        start, stop = width + 2, 0
        for near in range(max(0, row - 2), min(height, row + 1)):
            if runs[near, 0] < runs[near, 1]:
                start, stop = min(start, runs[near, 0]), max(stop, runs[near, 1] + 2 + SPARE)
        y = row - 1
        is_inside = 0 <= y < height
        for column in range(start, stop):
            x = column - 1
            if is_inside and runs[y, 0] <= x < runs[y, 1]:
                continue
            is_border = not is_inside or x < 0 or x >= width
            for channel in range(image.shape[2]):
                image[row, column, channel] = border if is_border else values[channel]


@compiled
def load_maps(maps, gains, runs, first, last, bounds, image):
    """Copy rows [first, last) of maps [C, h, w], times gains [C], into the runs of the image; other channels are 0.

    Rows' bounds [h, 2] receive the least and the largest value.
    """
    channels, count = np.uintp(len(maps)), np.uintp(image.shape[2])
    least, most = np.empty(channels, np.float32), np.empty(channels, np.float32)
    for y in range(first, last):
        least[:], most[:] = _0, _0
        for x in range(runs[y, 0], runs[y, 1]):
            for channel in range(channels):
                image[y + 1, x + 1, channel] = maps[channel, y, x] * gains[channel]
            for channel in range(channels):
                value = image[y + 1, x + 1, channel]
                least[channel], most[channel] = min(least[channel], value), max(most[channel], value)
            for channel in range(channels, count):
                image[y + 1, x + 1, channel] = _0
        bounds[y, 0], bounds[y, 1] = _span(least, most)


@compiled
def quantise(source, scale, zero, runs, first, last, out):
    """Round rows [first, last) of an image's runs to uint8."""
    inverse, offset = np.float32(1) / scale, zero + _HALF
    for y in range(first, last):
        for x in range(runs[y, 0] + 1, runs[y, 1] + 1):
            for channel in range(out.shape[2]):
                out[y + 1, x, channel] = np.uint8(min(max(source[y + 1, x, channel] * inverse + offset, _0), _MOST))


@compiled
def convolve_hidden(source, weights, factors, bias, before, is_residual, runs, first, last, bounds, out):
    """Convolve rows [first, last), leaky ReLU, and the sum with `before` if the layer is residual.

    Sums of products are multiplied by factors. Rows' bounds [h, 2] receive the least and the largest value.
    """
    channels = np.uintp(out.shape[2])
    sums, values = np.empty((BLOCK, weights.shape[2]), weights.dtype), np.empty(channels, np.float32)
    least, most = np.empty(channels, np.float32), np.empty(channels, np.float32)
    for y in range(first, last):
        least[:], most[:] = np.inf, -np.inf
        for x in range(runs[y, 0], runs[y, 1], BLOCK):
            _sum_windows(source, weights, y, x, sums)
            for pixel in range(min(BLOCK, runs[y, 1] - x)):
                for channel in range(channels):
                    value = np.float32(sums[pixel, channel]) * factors[channel] + bias[channel]
                    values[channel] = max(value, _SLOPE * value)
                if is_residual:
                    for channel in range(channels):
                        values[channel] += before[y + 1, x + pixel + 1, channel]
                for channel in range(channels):
                    out[y + 1, x + pixel + 1, channel] = values[channel]
                    least[channel] = min(least[channel], values[channel])
                    most[channel] = max(most[channel], values[channel])
        bounds[y, 0], bounds[y, 1] = _span(least, most)


@part
def _span(least, most):
    """Return the smallest and the largest: numba takes half a second to compile `min`."""
    lowest, highest = least[0], most[0]
    for channel in range(1, len(least)):
        lowest, highest = min(lowest, least[channel]), max(highest, most[channel])
    return lowest, highest


@compiled
def convolve_last(source, weights, factors, bias, runs, first, last, out):
    """Convolve rows [first, last) by the last layer into the doubled image [2h, 2w, D], four pixels for each."""
    channels = out.shape[2]
    sums = np.empty((BLOCK, weights.shape[2]), weights.dtype)
    for y in range(first, last):
        for x in range(runs[y, 0], runs[y, 1], BLOCK):
            _sum_windows(source, weights, y, x, sums)
            for pixel in range(min(BLOCK, runs[y, 1] - x)):
                for quarter in range(4):
                    row, column = 2 * y + quarter // 2, 2 * (x + pixel) + quarter % 2
                    for channel in range(channels):
                        at = quarter * channels + channel
                        out[row, column, channel] = np.float32(sums[pixel, at]) * factors[at] + bias[at]


@part
def _sum_windows(source, weights, y, x, sums):
    """Fill sums [BLOCK, outputs] for pixels from (x, y) on; the border's width makes theirs the windows' corners."""
    pixel_bytes = source.itemsize * source.shape[2]
    row_bytes = pixel_bytes * source.shape[1]
    corner = y * row_bytes + x * pixel_bytes
    if sums.shape[1] == 2 * LANES:
        window_sums(3, 6, 2, source, corner, pixel_bytes, row_bytes, weights, sums)
    elif sums.shape[1] == 3 * LANES:
        window_sums(3, 6, 3, source, corner, pixel_bytes, row_bytes, weights, sums)
    else:
        window_sums(3, 6, 4, source, corner, pixel_bytes, row_bytes, weights, sums)
