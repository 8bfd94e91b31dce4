"""Equals `MirroredSky.gloss` and `MirroredSky.of_even_light` of `nerf.mirrored_sky`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_part_loosely as part
from .octahedral import on_square

_0, _HALF, _1, _2 = (np.float32(value) for value in (0, 0.5, 1, 2))


@part
def not_mirrored(sky, to_eye, nail):
    """What is left of even light below the gloss: the first lobe on nails, the second on skin."""
    last = len(sky.reflectance) - 1
    place = min(max(to_eye, _0), _1) * np.float32(last)
    step = np.uintp(min(np.int64(place), last - 1))
    over = place - np.float32(step)
    below, above = sky.reflectance[step], sky.reflectance[step + 1]
    tight, broad = below[0] + over * (above[0] - below[0]), below[1] + over * (above[1] - below[1])
    tight += nail * (below[2] + over * (above[2] - below[2]) - tight)
    return _1 - broad - nail * (tight - broad)


@part
def mirror(sky, normal, view, nail, gloss, even):
    """Fill gloss [2, 3] with the light of a whole sky (`MirrorArrays`) in both lobes, and even [2] with that of 1."""
    along = normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]
    twice = _2 * along
    x, y, z = view[0] - twice * normal[0], view[1] - twice * normal[1], view[2] - twice * normal[2]
    u, v = on_square(x, y, z)
    half = np.float32(sky.side // 2)
    column, row = (u + _1) * half + _HALF, (v + _1) * half + _HALF
    left, top = min(max(np.int64(column), 0), sky.side), min(max(np.int64(row), 0), sky.side)
    right, below = column - np.float32(left), row - np.float32(top)
    at, wide = np.uintp(top * (sky.side + 2) + left), np.uintp(sky.side + 2)
    last = len(sky.reflectance) - 1
    place = min(max(-along, _0), _1) * np.float32(last)
    step = np.uintp(min(np.int64(place), last - 1))
    over = place - np.float32(step)
    for lobe in range(3 if nail > _0 else 2):
        reflected = (_1 - over) * sky.reflectance[step, lobe] + over * sky.reflectance[step + 1, lobe]
        if lobe == 2:
            even[0] += nail * (reflected - even[0])
        else:
            even[lobe] = reflected
        for c in range(3):
            upper = (_1 - right) * sky.radiance[at, lobe, c] + right * sky.radiance[at + 1, lobe, c]
            lower = (_1 - right) * sky.radiance[at + wide, lobe, c] + right * sky.radiance[at + wide + 1, lobe, c]
            light = reflected * ((_1 - below) * upper + below * lower)
            if lobe == 2:
                gloss[0, c] += nail * (light - gloss[0, c])
            else:
                gloss[lobe, c] = light
