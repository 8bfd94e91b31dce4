"""Equals `geometry.visibility.lit_share_reference`: one small shadow map per direction, compared with each vertex."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .raster import nearest_depth
from .records import ProjectedMesh

_HALF, _0, _1 = (np.float32(value) for value in (0.5, 0, 1))


@compiled
def lit_share(points, faces, size, first, last, lit):
    """Rasterise the shadow maps of directions [first, last), `size` px wide, and fill lit [K, V] in [0, 1]."""
    shadow = np.empty(size * size, np.float32)
    for index in range(first, last):
        shadow[:] = np.inf
        mesh = ProjectedMesh(points.px[index], points.depth[index], faces)
        nearest_depth(mesh, size, 0, size, True, shadow)
        for vertex in range(lit.shape[1]):
            x, y = points.lifted_px[index, vertex, 0], points.lifted_px[index, vertex, 1]
            lit[index, vertex] = _unblocked(shadow, size, x, y, points.lifted_depth[index, vertex] - points.bias)


@compiled
def _unblocked(shadow, size, x, y, depth):
    """Bilinear share of the four nearest map pixels that do not block a depth."""
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
