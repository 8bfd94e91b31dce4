"""Equals `MirroredSky.gloss` and `MirroredSky.of_even_light` of `light.mirrored_sky`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_part_loosely as part
from .octahedral import on_square

_0, _HALF, _1, _TINY = (np.float32(value) for value in (0, 0.5, 1, 1e-12))
SHARE, AHEAD, UP, WIDTH = range(4)
"""As in `light.round_lobes`."""


@part
def of_even_light(sky, to_eye, alpha_squared):
    """What a lobe reflects of light of 1 from everywhere."""
    row, below = _row(sky, alpha_squared)
    at, over = _column(sky, to_eye)
    return _mixed(sky.lobes, row, below, at, over, 0, SHARE) + _mixed(sky.lobes, row, below, at, over, 1, SHARE)


@part
def mirror(sky, normal, view, alpha_squared, gloss):
    """Add to gloss [3] the light of a whole sky (`MirrorArrays`) in a lobe; returns that of light of 1."""
    along = normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]
    inverse = _1 / max(np.sqrt(max(_1 - along * along, _0)), _TINY)
    x, y, z = view[0] - along * normal[0], view[1] - along * normal[1], view[2] - along * normal[2]
    (row, below), (at, over), even = _row(sky, alpha_squared), _column(sky, -along), _0
    for half in range(2):
        share = _mixed(sky.lobes, row, below, at, over, half, SHARE)
        ahead = _mixed(sky.lobes, row, below, at, over, half, AHEAD) * inverse
        up = _mixed(sky.lobes, row, below, at, over, half, UP)
        width = _mixed(sky.lobes, row, below, at, over, half, WIDTH)
        even += share
        dx, dy, dz = ahead * x + up * normal[0], ahead * y + up * normal[1], ahead * z + up * normal[2]
        _add_around(sky, dx, dy, dz, width, share, gloss)
    return even


@part
def _row(sky, alpha_squared):
    """Of the table, for a lobe, and how far below it lies."""
    last = len(sky.lobes) - 1
    rough = (np.sqrt(np.sqrt(alpha_squared)) - sky.least_roughness) / (_1 - sky.least_roughness)
    place = min(max(rough, _0), _1) * np.float32(last)
    row = min(np.int64(place), last - 1)
    return np.uintp(row), place - np.float32(row)


@part
def _column(sky, to_eye):
    last = sky.lobes.shape[1] - 1
    place = np.sqrt(_1 - min(max(to_eye, _0), _1)) * np.float32(last)
    at = min(np.int64(place), last - 1)
    return np.uintp(at), place - np.float32(at)


@part
def _mixed(lobes, row, below, at, over, half, value):
    """A value of a round lobe, bilinear in the table."""
    upper = (_1 - over) * lobes[row, at, half, value] + over * lobes[row, at + 1, half, value]
    lower = (_1 - over) * lobes[row + 1, at, half, value] + over * lobes[row + 1, at + 1, half, value]
    return (_1 - below) * upper + below * lower


@part
def _add_around(sky, x, y, z, width, share, light):
    """Add to light [3] a share of the mean around a direction."""
    u, v = on_square(x, y, z)
    half, wide = np.float32(sky.side // 2), np.uintp(sky.side + 2)
    column, row = (u + _1) * half + _HALF, (v + _1) * half + _HALF
    left, top = min(max(np.int64(column), 0), sky.side), min(max(np.int64(row), 0), sky.side)
    right, below = column - np.float32(left), row - np.float32(top)
    place = min(np.int64(width), sky.radiance.shape[1] - 2)
    level, wider = np.uintp(place), width - np.float32(place)
    at = np.uintp(top) * wide + np.uintp(left)
    for level_share, k in ((share * (_1 - wider), level), (share * wider, level + np.uintp(1))):
        for c in range(3):
            upper = (_1 - right) * sky.radiance[at, k, c] + right * sky.radiance[at + 1, k, c]
            lower = (_1 - right) * sky.radiance[at + wide, k, c] + right * sky.radiance[at + wide + 1, k, c]
            light[c] += level_share * ((_1 - below) * upper + below * lower)
