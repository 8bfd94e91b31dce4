"""Light at points, as `light.lighting`, and indirect diffuse light, as `light.indirect_diffuse.indirect_diffuse`."""

from __future__ import annotations

from collections import namedtuple
from math import pi
from typing import NamedTuple

import numpy as np

from .brdf import GRAZING, LEAST_COSINE, TINY, fresnel_parts, widened
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .series import decayed

_0, _HALF, _1, _2, _3, _4 = (np.float32(value) for value in (0, 0.5, 1, 2, 3, 4))
_16 = np.float32(16)
_PI, _LEAST_SQUARED_M, _TOUCHING_SQUARED_M = (np.float32(value) for value in (pi, 0.005**2, 1e-8))
_LEAST_LENGTH, _LEAST_FACING = np.float32(1e-12), np.float32(1e-6)
BLOCK = 128
"""Points whose light is computed at once."""
# Rows of a block, and of its sums.
_NORMAL, _RELIEF, _VIEW, _TO_EYE, _EYE_TERM, _FACING, _ARRIVING, _VALUE = 0, 3, 6, 9, 10, 12, 13, 14
_POSITION, _TOWARDS, _LONG, _TO_HALF, _ABOVE_FRESNEL, _BELOW_FRESNEL, _ROWS = 15, 18, 21, 22, 23, 24, 25
_SCATTERED, _VECTORS, _SEEN, _WHOLE, _SUMS = 0, 6, 15, 17, 19

PointArrays = namedtuple("PointArrays", "position normal relief_normal view_direction")
"""As `light.lighting.SurfacePoints`; numba allows no name `view`."""


class SkyArrays(NamedTuple):
    """K directions of the sky: unit [K, 3], flux [K, 3], brightness [K], share [K] of the sphere; shadows [K, R]."""

    towards: np.ndarray
    flux: np.ndarray
    brightness: np.ndarray
    share: np.ndarray
    lit: np.ndarray
    depth_in_m: np.ndarray


class LampArrays(NamedTuple):
    """As `light.lamp_samples.LampSamples`, and the shadows [K, R] of each sample at R points."""

    lamp: np.ndarray
    position: np.ndarray
    is_sun: np.ndarray
    axis: np.ndarray
    is_area: np.ndarray
    share: np.ndarray
    tan_spread: np.ndarray
    spread_share: np.ndarray
    cos_cone: np.ndarray
    cone_edge: np.ndarray
    shadow: np.ndarray
    rgb: np.ndarray
    lit: np.ndarray
    depth_in_m: np.ndarray


FeatureArrays = namedtuple("FeatureArrays", "lamp_vectors sky_vectors lobe_visibility scattered")
"""As those of `light.lighting.LightFeatures` at R points; zero at the start."""


class SurfelArrays(NamedTuple):
    """P discs of skin: position and normal [3, P], area [P], and radiance [3, P]."""

    position: np.ndarray
    normal: np.ndarray
    area_m2: np.ndarray
    emitted: np.ndarray


@compiled
def light_features(points, sky, lamps, lobes, first, last, out):
    """Fill the features of points [first, last) (`FeatureArrays`)."""
    work, sums = np.empty((_ROWS, BLOCK), np.float32), np.empty((_SUMS, BLOCK), np.float32)
    vectors = np.empty((3 * len(lamps.rgb), BLOCK), np.float32)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        _load(points, lobes, start, count, work)
        sums[:], vectors[:] = _0, _0
        for k in range(len(sky.towards)):
            if sky.share[k] > _0 and sky.brightness[k] > _0:
                _add_direction(sky, lobes, k, start, count, work, sums)
        for k in range(len(lamps.lamp)):
            _add_lamp(lamps, lobes, k, start, count, work, sums, vectors)
        _store(start, count, sums, vectors, out)


@compiled
def ambient_occlusion(towards, normal, lit, first, last, share, mean):
    """Fill share [R] and mean [R, 3] of points [first, last) as `light.lighting.ambient_occlusion`; normals [3, R]."""
    work, sums = np.empty((1, BLOCK), np.float32), np.empty((4, BLOCK), np.float32)
    for start in range(first, last, BLOCK):
        count, begin = min(BLOCK, last - start), np.uintp(start)
        sums[:] = _0
        for k in range(len(towards)):
            x, y, z = towards[k, 0], towards[k, 1], towards[k, 2]
            for index in range(np.uintp(count)):
                at = begin + index
                cosine = x * normal[0, at] + y * normal[1, at] + z * normal[2, at]
                work[0, index] = lit[k, at] * max(cosine, _0)
            for row, factor in enumerate((x, y, z, _1)):
                _add_row(sums[row], work[0], factor, count)
        for index in range(count):
            x, y, z = sums[0, index], sums[1, index], sums[2, index]
            length = max(np.sqrt(x * x + y * y + z * z), _LEAST_LENGTH)
            mean[start + index, 0], mean[start + index, 1], mean[start + index, 2] = x / length, y / length, z / length
            share[start + index] = _4 / np.float32(len(towards)) * sums[3, index]


@part
def _load(points, lobes, start, count, work):
    """Fill the rows of a block of points: what they are, and what the lobes need of normal and view."""
    for index in range(count):
        to_eye = _0
        for k in range(3):
            work[_POSITION + k, index] = points.position[start + index, k]
            work[_NORMAL + k, index] = points.normal[start + index, k]
            work[_RELIEF + k, index] = points.relief_normal[start + index, k]
            work[_VIEW + k, index] = points.view_direction[start + index, k]
            to_eye -= points.relief_normal[start + index, k] * points.view_direction[start + index, k]
        to_eye = max(to_eye, GRAZING)
        work[_TO_EYE, index] = to_eye
        for lobe in range(2):
            squared = widened(lobes.alpha[lobe], lobes.sky_cell_rad)
            work[_EYE_TERM + lobe, index] = np.sqrt(to_eye * to_eye * (_1 - squared) + squared)


@part
def _add_direction(sky, lobes, k, start, count, work, sums):
    """Add one direction of the sky to a block. Short loops over few rows each, which become vector instructions."""
    depth = sky.depth_in_m[k, start : start + count]
    lit = sky.lit[k, start : start + count]
    red, green, blue = sky.flux[k, 0], sky.flux[k, 1], sky.flux[k, 2]
    for layer in range(2):
        _scatter_row(sky.towards[k], lobes, layer, depth, work, work[_VALUE])
        at = _SCATTERED + 3 * layer
        _add_colours(sums[at], sums[at + 1], sums[at + 2], work[_VALUE], red, green, blue, count)
    _arriving_row(sky.towards[k], lit, work, work[_ARRIVING])
    for axis in range(3):
        at, along = _VECTORS + 3 * axis, sky.towards[k, axis]
        to = red * along, green * along, blue * along
        _add_colours(sums[at], sums[at + 1], sums[at + 2], work[_ARRIVING], to[0], to[1], to[2], count)
    _half_rows(sky.towards[k], lobes.squared_index, count, work)
    for lobe in range(2):
        squared = widened(lobes.alpha[lobe], lobes.sky_cell_rad)
        _lobe_row(squared, count, work[_EYE_TERM + lobe], work, work[_VALUE])
        _add_row(sums[_WHOLE + lobe], work[_VALUE], sky.brightness[k], count)
        _add_lit_row(sums[_SEEN + lobe], work[_VALUE], lit, sky.brightness[k])


@part
def _add_row(total, values, factor, count):
    for index in range(count):
        total[index] += values[index] * factor


@part
def _add_colours(reds, greens, blues, values, red, green, blue, count):
    """Add values times a colour to three rows."""
    for index in range(count):
        reds[index] += values[index] * red
        greens[index] += values[index] * green
        blues[index] += values[index] * blue


@part
def _add_lit_row(total, values, lit, factor):
    for index in range(len(lit)):
        total[index] += values[index] * lit[index] * factor


@part
def _scatter_row(towards, lobes, layer, depth_in_m, work, out):
    """Compute what arrives inside the skin from a direction."""
    x, y, z = towards[0], towards[1], towards[2]
    nx, ny, nz = work[_NORMAL], work[_NORMAL + 1], work[_NORMAL + 2]
    wrap, scale, rate = lobes.wrap[layer], lobes.scattered_scale[layer], _1 / (_16 * lobes.scatter_m[layer])
    for index in range(len(depth_in_m)):
        around = max((x * nx[index] + y * ny[index] + z * nz[index] + wrap) * scale, _0)
        out[index] = around * decayed(depth_in_m[index] * rate)


@part
def _arriving_row(towards, lit, work, out):
    """Compute the share of light from a direction that arrives above the horizon of the relief."""
    x, y, z = towards[0], towards[1], towards[2]
    rx, ry, rz, facing = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2], work[_FACING]
    for index in range(len(lit)):
        cosine = x * rx[index] + y * ry[index] + z * rz[index]
        facing[index] = max(cosine, LEAST_COSINE)
        out[index] = lit[index] if cosine > _0 else _0


@part
def _half_rows(towards, squared_index, count, work):
    """Compute what both lobes need of the half vector: its squared length, squared cosine, and Fresnel's reflectance.

    Half vectors are not of unit length: of two unit directions, half their length is the cosine to either. Both values
    besides the length are numerators over its square and `_BELOW_FRESNEL`.
    """
    x, y, z = towards[0], towards[1], towards[2]
    rx, ry, rz = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2]
    vx, vy, vz = work[_VIEW], work[_VIEW + 1], work[_VIEW + 2]
    long, facing_half, above, below = work[_LONG], work[_TO_HALF], work[_ABOVE_FRESNEL], work[_BELOW_FRESNEL]
    for index in range(count):
        hx, hy, hz = x - vx[index], y - vy[index], z - vz[index]
        squared = max(hx * hx + hy * hy + hz * hz, TINY)
        to_half = max(rx[index] * hx + ry[index] * hy + rz[index] * hz, _0)
        long[index], facing_half[index] = squared, min(to_half * to_half, squared)
        above[index], below[index] = fresnel_parts(min(_HALF * np.sqrt(squared), _1), squared_index)


@part
def _lobe_row(squared, count, eye_term, work, out):
    """Compute what a lobe reflects of a direction's light, if nothing hides it; as `brdf.ggx`."""
    long, facing_half, above, below = work[_LONG], work[_TO_HALF], work[_ABOVE_FRESNEL], work[_BELOW_FRESNEL]
    facing, to_eye = work[_FACING], work[_TO_EYE]
    for index in range(count):
        length, light = long[index], facing[index]
        base = facing_half[index] * (squared - _1) + length
        shadowing = light * eye_term[index] + to_eye[index] * np.sqrt(light * light * (_1 - squared) + squared)
        value = squared * _HALF * light * length * length * above[index] / (base * base * shadowing * below[index])
        out[index] = value if light > LEAST_COSINE else _0


@part
def _store(start, count, sums, vectors, out):
    for index in range(count):
        for c in range(3):
            for axis in range(3):
                out.sky_vectors[start + index, axis, c] = sums[_VECTORS + 3 * axis + c, index]
            for layer in range(2):
                out.scattered[start + index, layer, c] = sums[_SCATTERED + 3 * layer + c, index]
            for lamp in range(out.lamp_vectors.shape[1]):
                out.lamp_vectors[start + index, lamp, c] = vectors[3 * lamp + c, index]
        for lobe in range(2):
            out.lobe_visibility[start + index, lobe] = sums[_SEEN + lobe, index] / max(sums[_WHOLE + lobe, index], TINY)


@part
def _add_lamp(lamps, lobes, k, start, count, work, sums, vectors):
    """Add one sample of a lamp to a block."""
    lamp, shadow = lamps.lamp[k], lamps.shadow[k]
    depth, lit = lamps.depth_in_m[k, start : start + count], lamps.lit[k, start : start + count]
    _strength_rows(lamps, k, count, work, work[_ARRIVING])
    for layer in range(2):
        rate = shadow / (_16 * lobes.scatter_m[layer])
        _scatter_lamp_row(lobes, layer, rate, depth, work, work[_ARRIVING], work[_VALUE])
        for c in range(3):
            _add_row(sums[_SCATTERED + 3 * layer + c], work[_VALUE], lamps.rgb[lamp, c], count)
    x, y, z, strength = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2], work[_ARRIVING]
    rx, ry, rz = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2]
    for index in range(count):
        cosine = x[index] * rx[index] + y[index] * ry[index] + z[index] * rz[index]
        strength[index] *= shadow * lit[index] + _1 - shadow if cosine > lobes.below_horizon else _0
    for axis in range(3):
        _add_product(vectors[3 * lamp + axis], work[_TOWARDS + axis], strength, count)


@part
def _add_product(total, a, b, count):
    for index in range(count):
        total[index] += a[index] * b[index]


@part
def _scatter_lamp_row(lobes, layer, rate, depth_in_m, work, strength, out):
    """Compute what arrives inside the skin from a sample, whose direction is another at every point."""
    x, y, z = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2]
    nx, ny, nz = work[_NORMAL], work[_NORMAL + 1], work[_NORMAL + 2]
    wrap, scale = lobes.wrap[layer], lobes.scattered_scale[layer]
    for index in range(len(depth_in_m)):
        cosine = x[index] * nx[index] + y[index] * ny[index] + z[index] * nz[index]
        out[index] = max((cosine + wrap) * scale, _0) * decayed(depth_in_m[index] * rate) * strength[index]


@part
def _strength_rows(lamps, k, count, work, strength):
    """Fill the unit directions towards a sample, and the irradiance / pi of a surface that faces it."""
    px, py, pz, share = lamps.position[k, 0], lamps.position[k, 1], lamps.position[k, 2], lamps.share[k]
    x, y, z = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2]
    if lamps.is_sun[k]:
        for index in range(count):
            x[index], y[index], z[index], strength[index] = px, py, pz, share
        return
    at_x, at_y, at_z = work[_POSITION], work[_POSITION + 1], work[_POSITION + 2]
    for index in range(count):
        dx, dy, dz = px - at_x[index], py - at_y[index], pz - at_z[index]
        squared = max(dx * dx + dy * dy + dz * dz, _LEAST_SQUARED_M)
        inverse = _1 / np.sqrt(squared)
        x[index], y[index], z[index], strength[index] = dx * inverse, dy * inverse, dz * inverse, share / squared
    for index in range(count):
        along = -(x[index] * lamps.axis[k, 0] + y[index] * lamps.axis[k, 1] + z[index] * lamps.axis[k, 2])
        strength[index] *= _emitted(along, lamps, k)


@part
def _emitted(along, lamps, k):
    """Compute the intensity of a sample, per watt, in a direction with this cosine to its axis."""
    if lamps.is_area[k]:
        facing, tan_spread = max(along, _LEAST_FACING), lamps.tan_spread[k]
        tangent = np.sqrt(max(_1 / (facing * facing) - _1, _0))
        beam = max((tan_spread - tangent) * lamps.spread_share[k], _0) if tan_spread < np.inf else _1
        return max(along, _0) / _PI * beam
    edge = min(max((along - lamps.cos_cone[k]) * lamps.cone_edge[k], _0), _1)
    return (edge * edge * (_3 - _2 * edge) if lamps.cos_cone[k] >= -_1 else _1) / (_4 * _PI)


@compiled
def indirect(position, normal, surfels, first, last, received):
    """Fill what points [first, last) receive from surfels (`SurfelArrays`)."""
    factors = np.empty(surfels.emitted.shape[1], np.float32)
    for point in range(first, last):
        _fill_factors(position[point], normal[point], surfels, factors)
        _fill_received(factors, surfels.emitted, received[point])


@part
def _fill_factors(position, normal, surfels, factors):
    """Fill the form factors of a point and all surfels; apart from their sums, to become vector instructions."""
    x, y, z = position[0], position[1], position[2]
    nx, ny, nz = normal[0], normal[1], normal[2]
    for k in range(np.uintp(len(factors))):
        dx, dy, dz = surfels.position[0, k] - x, surfels.position[1, k] - y, surfels.position[2, k] - z
        squared = dx * dx + dy * dy + dz * dz
        here = max(dx * nx + dy * ny + dz * nz, _0)
        there = max(-(dx * surfels.normal[0, k] + dy * surfels.normal[1, k] + dz * surfels.normal[2, k]), _0)
        area_m2 = surfels.area_m2[k]
        factors[k] = here * there * area_m2 / (max(squared, _TOUCHING_SQUARED_M) * (_PI * squared + area_m2))


@part
def _fill_received(factors, emitted, out):
    """Fill out [3] with what arrives by these form factors."""
    total, red, green, blue = _0, _0, _0, _0
    for k in range(np.uintp(len(factors))):
        factor = factors[k]
        total += factor
        red += factor * emitted[0, k]
        green += factor * emitted[1, k]
        blue += factor * emitted[2, k]
    most = max(total, _1)
    out[0] = red / most
    out[1] = green / most
    out[2] = blue / most
