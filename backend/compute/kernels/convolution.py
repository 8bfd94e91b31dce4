"""Super-resolution's 3 x 3 convolutions over runs of pixels, one a row, instead of the whole image.

Images are [1 + h + 1, 1 + w + 1 + `SPARE`, C], their border zero: of fp32, or of uint8 that stand for
scale * (value - zero).
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .vectors import window_sums

BLOCK = 6
"""Pixels that are computed at once."""
DILATION = 2
"""Pixels beside the hand that are computed too: the network softens its edges."""
SPARE = BLOCK
"""Pixels to the right of the border, which the last block of a row may read."""
CHANNELS = 64
"""Of hidden layers: four vectors."""
LAST_CHANNELS = 48
"""Of the last layer at most: three vectors."""
SLOPE = 0.2
_SLOPE, _0, _HALF, _MOST = (np.float32(value) for value in (SLOPE, 0, 0.5, 255))


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
def load_maps(maps, runs, first, last, image):
    """Copy rows [first, last) of maps [C, h, w] into the runs of the image."""
    for y in range(first, last):
        for x in range(runs[y, 0], runs[y, 1]):
            for channel in range(len(maps)):
                image[y + 1, x + 1, channel] = maps[channel, y, x]


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
    """Rows [first, last) of a convolution to 64 channels, leaky ReLU, and the sum with `before` if it is residual.

    Sums of products are multiplied by factors [64]. Rows' bounds [h, 2] receive the least and the largest value.
    """
    sums, values = np.empty((BLOCK, CHANNELS), weights.dtype), np.empty(CHANNELS, np.float32)
    least, most = np.empty(CHANNELS, np.float32), np.empty(CHANNELS, np.float32)
    for y in range(first, last):
        least[:], most[:] = np.inf, -np.inf
        for x in range(runs[y, 0], runs[y, 1], BLOCK):
            _sum_windows(source, weights, y, x, sums)
            for pixel in range(min(BLOCK, runs[y, 1] - x)):
                for channel in range(CHANNELS):
                    value = np.float32(sums[pixel, channel]) * factors[channel] + bias[channel]
                    values[channel] = max(value, _SLOPE * value)
                if is_residual:
                    for channel in range(CHANNELS):
                        values[channel] += before[y + 1, x + pixel + 1, channel]
                for channel in range(CHANNELS):
                    out[y + 1, x + pixel + 1, channel] = values[channel]
                    least[channel] = min(least[channel], values[channel])
                    most[channel] = max(most[channel], values[channel])
        bounds[y, 0], bounds[y, 1] = least.min(), most.max()


@compiled
def convolve_last(source, weights, factors, bias, runs, first, last, out):
    """Rows [first, last) of the last convolution into the doubled image [2h, 2w, D], four pixels for each."""
    channels = out.shape[2]
    sums = np.empty((BLOCK, LAST_CHANNELS), weights.dtype)
    for y in range(first, last):
        for x in range(runs[y, 0], runs[y, 1], BLOCK):
            _sum_windows(source, weights, y, x, sums)
            for pixel in range(min(BLOCK, runs[y, 1] - x)):
                for part in range(4):
                    row, column = 2 * y + part // 2, 2 * (x + pixel) + part % 2
                    for channel in range(channels):
                        at = part * channels + channel
                        out[row, column, channel] = np.float32(sums[pixel, at]) * factors[at] + bias[at]


@compiled
def _sum_windows(source, weights, y, x, sums):
    """Fill sums [BLOCK, 64 or 48] for pixels from (x, y) on; the border's width makes theirs the windows' corners."""
    pixel_bytes = source.itemsize * source.shape[2]
    row_bytes = pixel_bytes * source.shape[1]
    corner = y * row_bytes + x * pixel_bytes
    if sums.shape[1] == LAST_CHANNELS:
        window_sums(3, 6, 3, source, corner, pixel_bytes, row_bytes, weights, sums)
    else:
        window_sums(3, 6, 4, source, corner, pixel_bytes, row_bytes, weights, sums)
