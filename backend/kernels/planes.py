"""Equals `field.encoding.FeaturePlane`: features of learned planes at a point of the atlas and a height."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

_HALF, _0, _1, _2 = (np.float32(value) for value in (0.5, 0, 1, 2))


@compiled
def read_plane(table, start, resolution, heights, channels, u, v, height, fade, scratch, out, at):
    """Write the plane's features, times `fade`, to out[at : at + channels].

    Its texels lie in the flat `table` from `start`: row-major over v, u, height layer, channel. The two layers about a
    height are neighbours in it, and are blended over the atlas together (in `scratch` [2 * channels]).
    """
    x, fx = _texel(u * np.float32(resolution) - _HALF, resolution)
    y, fy = _texel(v * np.float32(resolution) - _HALF, resolution)
    w00, w10 = fade * (_1 - fx) * (_1 - fy), fade * fx * (_1 - fy)
    w01, w11 = fade * (_1 - fx) * fy, fade * fx * fy
    texel = heights * channels
    a = start + (y * resolution + x) * texel
    b, c = a + texel, a + resolution * texel
    d = c + texel
    if heights == 1:
        for k in range(channels):
            out[at + k] = w00 * table[a + k] + w10 * table[b + k] + w01 * table[c + k] + w11 * table[d + k]
        return
    layer, share = _texel((min(max(height, -_1), _1) + _1) * np.float32(heights - 1) / _2, heights)
    skip = layer * channels
    a, b, c, d = a + skip, b + skip, c + skip, d + skip
    for k in range(2 * channels):
        scratch[k] = w00 * table[a + k] + w10 * table[b + k] + w01 * table[c + k] + w11 * table[d + k]
    for k in range(channels):
        out[at + k] = (_1 - share) * scratch[k] + share * scratch[channels + k]


@compiled
def _texel(position, count):
    """(first of the two texels about a position, share of the second), kept inside the grid."""
    position = min(max(position, _0), np.float32(count - 1))
    first = min(int(position), count - 2)
    return first, position - np.float32(first)
