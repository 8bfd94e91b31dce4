"""Equals `surface_means` of `image.surface_means`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part

_0, _1 = np.float32(0), np.float32(1)


@compiled
def mean_over_surface(rays, shares, facing_power, stride, before, first, last, after):
    """Fill `after` [R, C] for rays [first, last): means of `before` over rays beside them (`RaysOnSurface`)."""
    for index in range(first, last):
        _mean_of_ray(index, rays, shares, facing_power, stride, before, after)


@part
def _mean_of_ray(index, rays, shares, facing_power, stride, before, after):
    height, columns = len(rays.row) // rays.width, np.uintp(before.shape[1])
    here = np.uintp(index)
    y, x = rays.pixel[here] // rays.width, rays.pixel[here] % rays.width
    total = shares[0]
    for k in range(columns):
        after[here, k] = shares[0] * before[here, k]
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            there_y, there_x = y + stride * dy, x + stride * dx
            is_inside = 0 <= there_y < height and 0 <= there_x < rays.width
            if (dy == 0 and dx == 0) or not is_inside or rays.row[there_y * rays.width + there_x] < 0:
                continue
            other, off_m, facing = np.uintp(rays.row[there_y * rays.width + there_x]), _0, _0
            for k in range(3):
                off_m += (rays.position[other, k] - rays.position[here, k]) * rays.normal[here, k]
                facing += rays.normal[other, k] * rays.normal[here, k]
            if facing <= _0:
                continue
            off = off_m / rays.off_plane_m
            weight = shares[abs(dy) + abs(dx)] * facing**facing_power * np.exp(-off * off)
            total += weight
            for k in range(columns):
                after[here, k] += weight * before[other, k]
    inverse = _1 / total
    for k in range(columns):
        after[here, k] *= inverse
