"""Equals `geometry.visibility`: one small shadow map per direction of light, and what each vertex sees of it."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .raster import nearest_depth

_HALF, _0, _1 = (np.float32(value) for value in (0.5, 0, 1))


@compiled
def lit_share(
    positions_px,  # [K, V, 2] the vertices in every map
    depth,  # [K, V] in the map's units
    lifted_px,  # [K, V, 2] the points that look for the light
    lifted_depth,  # [K, V]
    bias,  # depth by which a blocker must lie nearer
    faces,  # [F, 3]
    size,  # of a map, px
    first,
    last,
    lit,  # [K, V] out, in [0, 1]
):
    """Draw the shadow maps of directions [first, last) and look the vertices up in them."""
    shadow = np.empty(size * size, np.float32)
    for index in range(first, last):
        shadow[:] = np.inf
        nearest_depth((positions_px[index], depth[index], faces), size, 0, size, True, shadow)
        for vertex in range(lit.shape[1]):
            x, y = lifted_px[index, vertex, 0], lifted_px[index, vertex, 1]
            lit[index, vertex] = _unblocked(shadow, size, x, y, lifted_depth[index, vertex] - bias)


@compiled
def _unblocked(shadow, size, x, y, depth):
    """Bilinear mean of the four nearest map pixels' verdicts."""
    limit = np.float32(size) - np.float32(1.001)
    x, y = min(max(x - _HALF, _0), limit), min(max(y - _HALF, _0), limit)
    column, row = int(x), int(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    pixel = row * size + column
    lit = _0
    if depth <= shadow[pixel]:
        lit += (_1 - fx) * (_1 - fy)
    if depth <= shadow[pixel + 1]:
        lit += fx * (_1 - fy)
    if depth <= shadow[pixel + size]:
        lit += (_1 - fx) * fy
    if depth <= shadow[pixel + size + 1]:
        lit += fx * fy
    return lit
