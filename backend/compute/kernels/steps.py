"""Normals and coefficients at steps of depth: as `image.depth_steps`."""

from __future__ import annotations

import numpy as np

from .brdf import TINY
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .image import neighbours

_0, _1 = (np.float32(value) for value in (0, 1))
_LEAST_OPACITY = np.float32(1e-3)  # as in `image.depth_steps`


@compiled
def step_normals(at, share, row, width, of_rays, normal, first, last, out):
    """Fill out [P, 3] for pixels [first, last) as `image.depth_steps.normals_at_steps`.

    `row` [h * w] is the index among the normals `of_rays` [R, 3] of a low-resolution pixel, -1 for none.
    """
    around, even, mean = np.empty(4, np.int64), np.empty(4, np.float32), np.empty(3, np.float32)
    for index in range(first, last):
        neighbours(len(row), width, at[index], around, even)
        total, off, squared = _0, _0, _0
        for k in range(4):
            even[k] = even[k] if row[around[k]] >= 0 else _0
            total += even[k]
        for k in range(4):
            off += abs(share[index, k] - even[k] / total)
        off = min(off, _1)
        mean[:] = _0
        for k in range(4):
            if row[around[k]] >= 0:
                for x in range(3):
                    mean[x] += share[index, k] * of_rays[row[around[k]], x]
        length = max(np.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]), TINY)
        for x in range(3):
            out[index, x] = (_1 - off) * normal[index, x] + off * mean[x] / length
            squared += out[index, x] * out[index, x]
        length = max(np.sqrt(squared), TINY)
        for x in range(3):
            out[index, x] /= length


@compiled
def step_coefficients(at, share, maps, width, alpha, first, last, out):
    """Replace `out` [P, 14] of pixels [first, last) as `image.depth_steps.coefficients_at_steps`.

    `maps` [h * w, C] begin with the rays' premultiplied coefficients and end with their opacity.
    """
    around, even, own = np.empty(4, np.int64), np.empty(4, np.float32), np.empty(4, np.float32)
    for index in range(first, last):
        neighbours(len(maps), width, at[index], around, even)
        all_, total = _0, _0
        for k in range(4):
            opacity = min(max(maps[around[k], maps.shape[1] - 1], _0), _1)
            even[k], own[k] = even[k] * opacity, share[index, k] * opacity
            all_, total = all_ + even[k], total + own[k]
        if all_ <= _LEAST_OPACITY or total <= _LEAST_OPACITY:
            continue
        off = _0
        for k in range(4):
            off += abs(own[k] / total - even[k] / all_)
        if off > _0:
            scale = min(max(alpha[at[index]], _0), _1) / total
            _mix(maps, around, share[index], scale, min(off, _1), out[index])


@part
def _mix(maps, around, share, scale, off, out):
    """Mix a share of the rays' coefficients into those of a pixel."""
    for c in range(len(out)):
        of_rays = _0
        for k in range(4):
            of_rays += share[k] * maps[around[k], c]
        out[c] += off * (scale * of_rays - out[c])
