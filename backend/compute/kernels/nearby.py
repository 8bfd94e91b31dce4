"""Light of nearby geometry, as `light.near_field_light.near_field_light`."""

from __future__ import annotations

from collections import namedtuple
from math import pi
from typing import NamedTuple

import numpy as np

from .brdf import GRAZING, LEAST_COSINE, TINY, fresnel, on_square, widened
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part

_0, _HALF, _1, _PI, _LEAST_M = (np.float32(value) for value in (0, 0.5, 1, pi, 0.001))
# Rows of what is known of a point and all patches.
_TOWARDS, _FACTOR, _DISTANCE, _COSINE, _VALUE, _ROWS = 0, 3, 4, 5, 6, 7


class PatchArrays(NamedTuple):
    """P patches around a hand, as seen from R points.

    Attributes:
        position: [3, P] m, world.
        normal: [3, P].
        area_m2: [P].
        emitted: [3, P] radiance.
        occlusion: [R, K] share of each of the sky's directions that the hand alone leaves open at each point.
        sky_cell: [cells * cells, N] the sky's directions nearest to each cell of directions.
        sky_weight: of these.
        cells: along a side.
    """

    position: np.ndarray
    normal: np.ndarray
    area_m2: np.ndarray
    emitted: np.ndarray
    occlusion: np.ndarray
    sky_cell: np.ndarray
    sky_weight: np.ndarray
    cells: int


NearArrays = namedtuple("NearArrays", "sky_vectors near_field_specular scattered")
"""As `light.near_field_light.NearFieldFeatures` at R points."""


@compiled
def near_field_light(points, patches, lobes, first, last, out):
    """Fill what points [first, last) receive from patches (`PatchArrays`) (`NearArrays`)."""
    work, cells = np.empty((_ROWS, len(patches.area_m2)), np.float32), np.empty(len(patches.area_m2), np.int32)
    for point in range(first, last):
        _fill_factors(points.position[point], patches, work, cells)
        _hide(patches.sky_cell, patches.sky_weight, cells, patches.occlusion[point], work[_FACTOR])
        _level(points.relief_normal[point], work)
        for axis in range(3):
            _multiply(work[_FACTOR], work[_TOWARDS + axis], work[_COSINE], work[_VALUE])
            _fill_sums(work[_VALUE], patches.emitted, out.sky_vectors[point, axis])
        for layer in range(2):
            _scatter(points.normal[point], lobes, layer, work, work[_VALUE])
            _fill_sums(work[_VALUE], patches.emitted, out.scattered[point, layer])
            _reflect(
                points.relief_normal[point], points.view_direction[point], lobes, layer, patches, work, work[_VALUE]
            )
            _fill_sums(work[_VALUE], patches.emitted, out.near_field_specular[point, layer])


@part
def _fill_factors(position, patches, work, cells):
    """Fill directions, distances and form factors without the point's own cosine; cells of the directions."""
    at_x, at_y, at_z = position[0], position[1], position[2]
    x, y, z = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2]
    factor, distance = work[_FACTOR], work[_DISTANCE]
    half = np.float32(patches.cells // 2)
    for k in range(np.uintp(len(cells))):
        dx, dy, dz = patches.position[0, k] - at_x, patches.position[1, k] - at_y, patches.position[2, k] - at_z
        length = max(np.sqrt(dx * dx + dy * dy + dz * dz), _LEAST_M)
        dx, dy, dz = dx / length, dy / length, dz / length
        there = max(-(dx * patches.normal[0, k] + dy * patches.normal[1, k] + dz * patches.normal[2, k]), _0)
        area_m2 = patches.area_m2[k]
        x[k], y[k], z[k], distance[k] = dx, dy, dz, length
        factor[k] = there * area_m2 / (_PI * length * length + area_m2)
    for k in range(np.uintp(len(cells))):
        u, v = on_square(x[k], y[k], z[k])
        column = min(max(np.int32((u + _1) * half), 0), patches.cells - 1)
        row = min(max(np.int32((v + _1) * half), 0), patches.cells - 1)
        cells[k] = row * patches.cells + column


@part
def _hide(sky_cell, sky_weight, cells, occlusion, factor):
    """Scale the factors by the visibility of their directions past the hand itself."""
    for k in range(len(cells)):
        share, cell = _0, cells[k]
        for near in range(sky_cell.shape[1]):
            share += occlusion[sky_cell[cell, near]] * sky_weight[cell, near]
        factor[k] *= share


@part
def _level(relief, work):
    """Scale the factors to a sum of 1 at most; cosines become 1 above the horizon and 0 below."""
    factor, cosine = work[_FACTOR], work[_COSINE]
    x, y, z = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2]
    total = _0
    for k in range(np.uintp(len(factor))):
        facing = x[k] * relief[0] + y[k] * relief[1] + z[k] * relief[2]
        total += factor[k] * max(facing, _0)
        cosine[k] = _1 if facing > _0 else _0
    scale = _1 / max(total, _1)
    for k in range(np.uintp(len(factor))):
        factor[k] *= scale


@part
def _multiply(a, b, c, out):
    for k in range(np.uintp(len(out))):
        out[k] = a[k] * b[k] * c[k]


@part
def _scatter(normal, lobes, layer, work, out):
    x, y, z, factor = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2], work[_FACTOR]
    wrap, scale = lobes.wrap[layer], lobes.scattered_scale[layer]
    for k in range(np.uintp(len(out))):
        cosine = x[k] * normal[0] + y[k] * normal[1] + z[k] * normal[2]
        out[k] = factor[k] * max(cosine + wrap, _0) * scale


@part
def _reflect(relief, view, lobes, lobe, patches, work, out):
    """Compute what a lobe reflects; as `brdf.ggx`."""
    x, y, z, factor, distance = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2], work[_FACTOR], work[_DISTANCE]
    to_eye = max(-(relief[0] * view[0] + relief[1] * view[1] + relief[2] * view[2]), GRAZING)
    alpha = lobes.alpha[lobe]
    for k in range(np.uintp(len(out))):
        hx, hy, hz = x[k] - view[0], y[k] - view[1], z[k] - view[2]
        inverse = _1 / max(np.sqrt(hx * hx + hy * hy + hz * hz), TINY)
        to_half = min(max((relief[0] * hx + relief[1] * hy + relief[2] * hz) * inverse, _0), _1)
        reflectance = fresnel((x[k] * hx + y[k] * hy + z[k] * hz) * inverse, lobes.squared_index)
        squared = widened(alpha, np.sqrt(patches.area_m2[k] / _PI) / distance[k])
        base = to_half * to_half * (squared - _1) + _1
        cosine = x[k] * relief[0] + y[k] * relief[1] + z[k] * relief[2]
        light = max(cosine, LEAST_COSINE)
        shadowing = light * np.sqrt(to_eye * to_eye * (_1 - squared) + squared) + to_eye * np.sqrt(
            light * light * (_1 - squared) + squared
        )
        out[k] = work[_COSINE, k] * factor[k] * squared * _HALF * reflectance * light / (base * base * shadowing)


@part
def _fill_sums(values, emitted, out):
    """Fill out [3] with the patches' light times these values."""
    red, green, blue = _0, _0, _0
    for k in range(np.uintp(len(values))):
        red += values[k] * emitted[0, k]
        green += values[k] * emitted[1, k]
        blue += values[k] * emitted[2, k]
    out[0], out[1], out[2] = red, green, blue
