"""Equals `on_square` of `light.octahedral`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_part_loosely as part

_0, _1 = (np.float32(value) for value in (0, 1))


@part
def on_square(x, y, z):
    """(u, v) in [-1, 1] of a direction of any length but 0."""
    total = abs(x) + abs(y) + abs(z)
    u, v = x / total, y / total
    if z < _0:
        return np.copysign(_1 - abs(v), u), np.copysign(_1 - abs(u), v)
    return u, v
