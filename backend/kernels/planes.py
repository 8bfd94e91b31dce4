"""Equals `field.encoding.FeaturePlane`: features of learned planes at a point of the atlas and a height."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

BLOCK = 4
"""Channels are read in blocks of this many: a number known at compile time, so that each fits one register."""
_HALF, _0, _1, _2 = (np.float32(value) for value in (0.5, 0, 1, 2))
_BLOCK = np.uintp(BLOCK)


@compiled
def read_plane(table, start, resolution, heights, channels, u, v, height, fade, out, at):
    """Write the plane's features, times `fade`, to out[at : at + channels], channels a multiple of BLOCK.

    Its texels lie in the flat `table` from `start`: row-major over v, u, height layer, channel.
    """
    x, fx = _texel(u * np.float32(resolution) - _HALF, resolution)
    y, fy = _texel(v * np.float32(resolution) - _HALF, resolution)
    w00, w10 = fade * (_1 - fx) * (_1 - fy), fade * fx * (_1 - fy)
    w01, w11 = fade * (_1 - fx) * fy, fade * fx * fy
    texel = heights * channels
    layer, share = 0, _0
    if heights > 1:
        layer, share = _texel((height + _1) * np.float32(heights - 1) / _2, heights)
    corner = start + (y * resolution + x) * texel + layer * channels
    # Unsigned, because numba lets signed indices count from the end, which costs a comparison each.
    a, b = np.uintp(corner), np.uintp(corner + texel)
    c, d = np.uintp(corner + resolution * texel), np.uintp(corner + (resolution + 1) * texel)
    to, above, last = np.uintp(at), np.uintp(channels), np.uintp(at + channels)
    while to < last:
        for k in range(_BLOCK):
            value = w00 * table[a + k] + w10 * table[b + k] + w01 * table[c + k] + w11 * table[d + k]
            if heights > 1:
                i = k + above
                higher = w00 * table[a + i] + w10 * table[b + i] + w01 * table[c + i] + w11 * table[d + i]
                value += share * (higher - value)
            out[to + k] = value
        a, b, c, d, to = a + _BLOCK, b + _BLOCK, c + _BLOCK, d + _BLOCK, to + _BLOCK


@compiled
def _texel(position, count):
    """(first of the two texels about a position, share of the second), kept inside the grid."""
    position = min(max(position, _0), np.float32(count - 1))
    first = min(int(position), count - 2)
    return first, position - np.float32(first)
