"""Equals `field.encoding.FeaturePlane`: features of learned planes at a point of the atlas and a height; gradients."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .vectors import blend_texels

BLOCK = 4
"""Channels are read in blocks of this many, which fit one register."""
_HALF, _0, _1, _2 = (np.float32(value) for value in (0.5, 0, 1, 2))
_BLOCK = np.uintp(BLOCK)


@part
def read_plane(table, start, resolution, heights, channels, u, v, height, fade, out, at):
    """Write the plane's features, times `fade`, to out[at : at + channels], channels a multiple of BLOCK.

    Its texels lie in the flat `table`, of fp32 or of half precision, from `start`: row-major over v, u, height layer,
    channel.
    """
    cell, fx, fy, share = _cell(u, v, height, (resolution, heights, channels))
    low, high = fade * (_1 - fy), fade * fy
    weights = (_1 - fx) * low, fx * low, (_1 - fx) * high, fx * high
    texel = np.intp(heights * channels)
    row, above = resolution * texel, np.intp(channels) if heights > 1 else np.intp(0)
    for done in range(0, channels, BLOCK):
        blend_texels(table, np.intp(start) + np.intp(cell) + done, texel, row, above, weights, share, out, at + done)


@part
def _texel(position, count):
    """(first of the two texels about a position, share of the second), kept inside the grid, NaN too."""
    position = min(max(position, _0), np.float32(count - 1))
    first = max(min(int(position), count - 2), 0)
    return first, position - np.float32(first)


@compiled
def read_samples(table, sizes, uv, height, fade, first, last, out, columns, at):
    """Write the features of samples [first, last), times `fade`, to columns [at, at + channels) of `out`.

    Here and below: `table`, `out` and the features' gradient are flat, rows of the last two have so many `columns`;
    sizes = (resolution, heights, channels), any number of channels; uv [S, 2], height [S], fade [S].
    """
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    above = np.uintp(channels if heights > 1 else 0)
    for sample in range(first, last):
        a, fx, fy, share = _cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        corners = a, a + texel_size, a + row_size, a + row_size + texel_size
        low, high = fade[sample] * (_1 - fy), fade[sample] * fy
        weights = (_1 - fx) * low, fx * low, (_1 - fx) * high, fx * high
        to, done = np.uintp(sample * columns + at), np.uintp(0)
        while done + _BLOCK <= np.uintp(channels):
            for k in range(_BLOCK):
                below = _bilinear(table, corners, done + k, weights)
                out[to + done + k] = below + share * (_bilinear(table, corners, done + k + above, weights) - below)
            done += _BLOCK
        while done < np.uintp(channels):
            below = _bilinear(table, corners, done, weights)
            out[to + done] = below + share * (_bilinear(table, corners, done + above, weights) - below)
            done += np.uintp(1)


@compiled
def table_gradient(sizes, uv, height, fade, outward, columns, at, first, last, gradient):
    """Add to `gradient`, of rows [first, last) of the flat table, what the features' gradient `outward` gives.

    Each texel's sum runs in the order of the samples, so that the result is bit-identical for any split of the rows.
    """
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    above = np.uintp(channels)
    for sample in range(len(uv)):
        y, fy = _texel(uv[sample, 1] * np.float32(resolution) - _HALF, resolution)
        if y + 1 < first or y >= last:
            continue
        cell, fx, fy, share = _cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        source = np.uintp(sample * columns + at)
        for side in range(2):
            if first <= y + side < last:
                weight = fade[sample] * (fy if side == 1 else _1 - fy)
                left, low = cell + np.uintp(side) * row_size, _1 - share
                right = left + texel_size
                _add(gradient, left, outward, source, above, (_1 - fx) * weight * low)
                _add(gradient, right, outward, source, above, fx * weight * low)
                if heights > 1:
                    _add(gradient, left + above, outward, source, above, (_1 - fx) * weight * share)
                    _add(gradient, right + above, outward, source, above, fx * weight * share)


@compiled
def place_gradient(table, sizes, uv, height, fade, outward, columns, at, first, last, gradient):
    """Add the gradients of u, v, height and fade of samples [first, last) to `gradient` [S, 4]."""
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    for sample in range(first, last):
        cell, fx, fy, share = _cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        source = np.uintp(sample * columns + at)
        a = _dots(table, cell, outward, source, sizes)
        b = _dots(table, cell + texel_size, outward, source, sizes)
        c = _dots(table, cell + row_size, outward, source, sizes)
        d = _dots(table, cell + row_size + texel_size, outward, source, sizes)
        mean_a, mean_b = a[0] + share * (a[1] - a[0]), b[0] + share * (b[1] - b[0])
        mean_c, mean_d = c[0] + share * (c[1] - c[0]), d[0] + share * (d[1] - d[0])
        along_x = (_1 - fy) * (mean_b - mean_a) + fy * (mean_d - mean_c)
        along_y = (_1 - fx) * (mean_c - mean_a) + fx * (mean_d - mean_b)
        along_layers = (_1 - fy) * ((_1 - fx) * (a[1] - a[0]) + fx * (b[1] - b[0]))
        along_layers += fy * ((_1 - fx) * (c[1] - c[0]) + fx * (d[1] - d[0]))
        per_texel = fade[sample] * np.float32(resolution)
        for axis, along in enumerate((along_x, along_y)):
            position = uv[sample, axis] * np.float32(resolution) - _HALF
            if _0 <= position <= np.float32(resolution - 1):
                gradient[sample, axis] += per_texel * along
        if heights > 1 and -_1 <= height[sample] <= _1:
            gradient[sample, 2] += fade[sample] * along_layers * np.float32(heights - 1) / _2
        gradient[sample, 3] += mean_a + fx * (mean_b - mean_a) + fy * along_y


@part
def _cell(u, v, height, sizes):
    """(where the first corner's features begin in the flat table, shares of the next in u, in v and in height)."""
    resolution, heights, channels = sizes
    x, fx = _texel(u * np.float32(resolution) - _HALF, resolution)
    y, fy = _texel(v * np.float32(resolution) - _HALF, resolution)
    layer, share = 0, _0 * height
    if heights > 1:
        layer, share = _texel((height + _1) * np.float32(heights - 1) / _2, heights)
    return np.uintp(((y * resolution + x) * heights + layer) * channels), fx, fy, share


@compiled
def _bilinear(table, corners, offset, weights):
    """One feature between four corners of a layer."""
    below = weights[0] * table[corners[0] + offset] + weights[1] * table[corners[1] + offset]
    return below + weights[2] * table[corners[2] + offset] + weights[3] * table[corners[3] + offset]


@compiled
def _add(gradient, to, outward, source, channels, weight):
    """gradient[to :] += weight * outward[source :], `channels` of them."""
    done = np.uintp(0)
    while done + _BLOCK <= channels:
        for k in range(_BLOCK):
            gradient[to + done + k] += weight * outward[source + done + k]
        done += _BLOCK
    while done < channels:
        gradient[to + done] += weight * outward[source + done]
        done += np.uintp(1)


@compiled
def _dots(table, corner, outward, source, sizes):
    """Inner products of the features' gradient with a corner's features, and with those of the layer above."""
    _, heights, channels = sizes
    low = high = _0 * outward[source]
    for k in range(np.uintp(channels)):
        low += table[corner + k] * outward[source + k]
        if heights > 1:
            high += table[corner + np.uintp(channels) + k] * outward[source + k]
    return low, high
