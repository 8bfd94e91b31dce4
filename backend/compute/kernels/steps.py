"""Which rays count at pixels by their depth, as `image.shading`, and what follows at steps, as `image.depth_steps`."""

from __future__ import annotations

import numpy as np

from .brdf import TINY
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .image import neighbours

_0, _1 = (np.float32(value) for value in (0, 1))
LEAST_SHARE, OF_PIXEL, OF_NEXT = (np.float32(value) for value in (0.01, 0.5, 0.125))
"""As in `image.shading`."""
_LEAST_OPACITY = np.float32(1e-3)  # as in `image.depth_steps`


@compiled
def ray_shares(pixel, width, depth_of_rays, skin_depth, edge_m, first, last, shares):
    """Fill shares [P, 4] of pixels [first, last) as `image.shading.shares_of_rays`.

    `depth_of_rays` [h * w] is infinite where there is no ray, `skin_depth` [H * W] beside the hand.
    """
    height, large = len(depth_of_rays) // width, 2 * width
    at, share, own, summed = (
        np.empty(4, np.int64),
        np.empty(4, np.float32),
        np.empty(4, np.float32),
        np.empty(4, np.float32),
    )
    depths, beside = np.empty(4, np.float32), np.empty(4, np.float32)
    for index in range(first, last):
        here = pixel[index]
        row, column, depth = here // large, here % large, skin_depth[here]
        neighbours(len(depth_of_rays), width, here, at, share)
        for k in range(4):
            depths[k] = depth_of_rays[at[k]]
            share[k] = share[k] if depths[k] < np.inf else _0
        _guided(share, depths, depth, edge_m, own)
        beside[0], beside[1] = skin_depth[here - min(column, 1)], skin_depth[here + min(large - 1 - column, 1)]
        beside[2] = skin_depth[here - large * min(row, 1)]
        beside[3] = skin_depth[here + large * min(2 * height - 1 - row, 1)]
        is_edge = False
        for k in range(4):
            is_edge = is_edge or abs(beside[k] - depth) > edge_m
        if is_edge:
            for k in range(4):
                own[k] *= OF_PIXEL
            for one in range(4):
                _guided(share, depths, beside[one], edge_m, summed)
                for k in range(4):
                    own[k] += OF_NEXT * summed[k]
        for k in range(4):
            shares[index, k] = own[k]


@part
def _guided(share, depths, depth, edge_m, out):
    """Keep the shares of the rays at a depth, or of all if none is there."""
    total, plain = _0, _0
    for k in range(4):
        gap = (depth - depths[k]) / edge_m
        out[k] = share[k] * np.exp(-gap * gap) if share[k] > _0 and depth < np.inf else _0
        total += out[k]
        plain += share[k]
    for k in range(4):
        out[k] = out[k] / total if total > LEAST_SHARE else share[k] / plain


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
