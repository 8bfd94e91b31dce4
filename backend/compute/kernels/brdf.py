"""The specular lobes and how a bump changes them: as `light.brdf`, `light.brdf` and `light.prefiltered_environment`.

Of `light.prefiltered_environment` it has `on_square`, of `PrefilteredEnvironment` `specular` and `of_even_light`.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from .compiled import compiled_part_loosely as part
from .vectors import blend_texels

_0, _QUARTER, _HALF, _1, _2, _TINY = (np.float32(value) for value in (0, 0.25, 0.5, 1, 2, 1e-12))
LEAST_COSINE, GRAZING, TINY = (np.float32(value) for value in (1e-4, 0.05, 1e-8))
"""Of the cosines to light and eye, and of what is divided by, as in `light.brdf`."""
_TAIL, _FACES_TURN, _POSITIVE_PART, _STEEPER = (np.float32(value) for value in (8, 0.05, 2 / pi, 1 / 0.9))
"""As in `light.brdf`."""
LEAST_MIRRORED, LEAST_OF_EYE, LEAST_BEND = (np.float32(value) for value in (0.01, 0.9, 1e-4))
"""As in `light.brdf`."""


class Lobes(NamedTuple):
    """Constants of `light.lighting` and `light.brdf`.

    SCATTER_M, WRAP, SCATTERED_SCALE and alpha (squared ROUGHNESS) [2], the angle of a sky cell, the squared INDEX, and
    BELOW_HORIZON; `nail_alpha` is the first lobe's on nails, `skin_squared` the squared alpha of skin by itself.
    """

    scatter_m: np.ndarray
    wrap: np.ndarray
    scattered_scale: np.ndarray
    alpha: np.ndarray
    nail_alpha: np.float32
    sky_cell_rad: np.float32
    squared_index: np.float32
    below_horizon: np.float32
    skin_squared: np.float32


class MirrorArrays(NamedTuple):
    """As `light.prefiltered_environment.PrefilteredEnvironment`, its `SIDE`, and `LEAST_ROUGHNESS` of `light.brdf`.

    Texels of `radiance` have a fourth channel, which is not used: both tables are read in fours.
    """

    radiance: np.ndarray
    lobes: np.ndarray
    side: int
    least_roughness: np.float32


@part
def widened(alpha, light_radius_rad):
    """Return the squared alpha of a lobe, widened by the light."""
    return min(alpha * alpha + light_radius_rad * light_radius_rad * _QUARTER, _1)


@part
def fresnel(cosine, squared_index):
    """Compute the reflected share, as `light.brdf.fresnel`."""
    above, below = fresnel_parts(min(max(cosine, _0), _1), squared_index)
    return above / below


@part
def fresnel_parts(cosine, squared_index):
    """Compute numerator and denominator of the reflected share for a cosine in [0, 1], to be divided once."""
    inside = np.sqrt(squared_index - _1 + cosine * cosine)
    less, more = inside - cosine, inside + cosine
    across, along = cosine * more - _1, cosine * less + _1
    below = more * along
    return _HALF * less * less * (along * along + across * across), below * below


@part
def on_nail(nail, lobes):
    """Return the squared alpha of the first lobe."""
    alpha = lobes.alpha[0] + (lobes.nail_alpha - lobes.alpha[0]) * nail
    return alpha * alpha


@part
def ggx(to_light, x, y, z, normal, view, light_radius_rad, alphas_squared, lobes, tight, broad):
    """Compute the sum of two lobes of these weights, a light in direction (x, y, z), of cosine `to_light`."""
    hx, hy, hz = x - view[0], y - view[1], z - view[2]
    inverse = _1 / max(np.sqrt(hx * hx + hy * hy + hz * hz), TINY)
    to_eye = -(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2])
    to_half = min(max((normal[0] * hx + normal[1] * hy + normal[2] * hz) * inverse, _0), _1)
    along_half = min(max((x * hx + y * hy + z * hz) * inverse, _0), _1)
    both = _0
    if tight > _0:
        lobe = _lobe(to_light, to_eye, to_half, along_half, alphas_squared[0], _0, light_radius_rad)
        both += tight * lobe
    if broad > _0:
        hidden = max(alphas_squared[1] - lobes.skin_squared, _0)
        lobe = _lobe(to_light, to_eye, to_half, along_half, alphas_squared[1], hidden, light_radius_rad)
        both += broad * lobe
    return fresnel(along_half, lobes.squared_index) * both


@part
def _lobe(to_light, to_eye, to_half, along_half, alpha_squared, hidden, light_radius_rad):
    """Compute a lobe without Fresnel; `hidden`: the variance of slopes of bumps in its squared alpha."""
    squared = min(alpha_squared + light_radius_rad * light_radius_rad * _QUARTER, _1)
    if hidden <= _0 and to_light <= _0:
        return _0
    smooth, facing = squared - hidden, to_half * to_half
    across = _1 - facing
    if hidden > _0:
        towards_half = hidden * to_half / (squared * facing + across)
        inverse = _1 / np.sqrt(_1 + towards_half * towards_half * across)
        kept, added = (_1 - towards_half * to_half) * inverse, towards_half * along_half * inverse
        to_light, to_eye = kept * to_light + added, kept * to_eye + added
        variance = _HALF * hidden * (_1 - towards_half) * max(_1 - to_light * to_light, _0)
        to_light = _HALF * (to_light + np.sqrt(to_light * to_light + _POSITIVE_PART * variance))
        reach = _TAIL * squared * facing
        squared = smooth + hidden * reach / max(reach + across, TINY)
    to_light, to_eye = max(to_light, LEAST_COSINE), max(to_eye, GRAZING)
    base = facing * (squared - _1) + _1
    shadowing = to_light * np.sqrt(to_eye * to_eye * (_1 - smooth) + smooth) + to_eye * np.sqrt(
        to_light * to_light * (_1 - smooth) + smooth
    )
    return squared / (base * base) * _HALF / shadowing * to_light


@part
def share_above(to_light, light_radius_rad):
    """Compute the share of a light above a surface, by the cosine of its middle and the surface's normal."""
    return min(max(_HALF + _HALF * to_light / (_FACES_TURN + light_radius_rad), _0), _1)


@part
def bump_shadowing(facing, x, y, z, along, surface_normal):
    """Compute the share of a light in direction (x, y, z), of cosine `facing`; `along`: cosine of both normals."""
    share = x * surface_normal[0] + y * surface_normal[1] + z * surface_normal[2]
    share = min(max(share / max(facing * along, TINY), _0), _1)
    return share * (_1 + share - share * share)


@part
def horizon_occlusion(above, to_eye, alpha_squared):
    """Compute a lobe's share; `above`: cosine of mirrored view and surface's normal, `to_eye`: and the bump's own."""
    share, whole = _part_of_lobe(above, alpha_squared), _part_of_lobe(max(to_eye, _0), alpha_squared)
    return min(share / whole, _1)


@part
def _part_of_lobe(cosine, alpha_squared):
    tangent = cosine / (_1 + np.sqrt(max(_1 - cosine * cosine, _0)))
    return _1 + tangent / np.sqrt(alpha_squared + tangent * tangent)


@part
def clamped_reflection_normal(normal, surface_normal, view, along, out):
    """Fill out [3]; `along`: cosine of both normals."""
    up = -(surface_normal[0] * view[0] + surface_normal[1] * view[1] + surface_normal[2] * view[2])
    facing = -(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2])
    least = min(LEAST_OF_EYE * up, LEAST_MIRRORED)
    for k in range(3):
        out[k] = normal[k]
    if up <= _0 or _2 * facing * along - up >= least:
        return
    bend = np.sqrt(max(_1 - along * along, _0))
    if bend <= LEAST_BEND:
        return
    across = (facing - along * up) / bend
    reach = np.arccos(min(least / max(np.sqrt(up * up + across * across), TINY), _1))
    kept = _HALF * (np.arctan2(across, up) + reach)
    cosine, sine = np.cos(kept), np.sin(kept) / bend
    for k in range(3):
        out[k] = cosine * surface_normal[k] + sine * (normal[k] - along * surface_normal[k])


@part
def glossy_normal(normal, surface_normal, along, out):
    """Fill out [3] and return the cosine of it and the surface's normal; `along`: cosine of both normals."""
    less = (_STEEPER - _1) * along
    x = _STEEPER * normal[0] - less * surface_normal[0]
    y = _STEEPER * normal[1] - less * surface_normal[1]
    z = _STEEPER * normal[2] - less * surface_normal[2]
    inverse = _1 / max(np.sqrt(x * x + y * y + z * z), TINY)
    out[0], out[1], out[2] = x * inverse, y * inverse, z * inverse
    return along * inverse


@part
def on_square(x, y, z):
    """Map a direction of any length but 0 to (u, v) in [-1, 1]."""
    total = abs(x) + abs(y) + abs(z)
    u, v = x / total, y / total
    if z < _0:
        return np.copysign(_1 - abs(v), u), np.copysign(_1 - abs(u), v)
    return u, v


SHARE, AHEAD, UP, WIDTH = range(4)
"""As in `light.brdf`."""
_FOUR = 4


@part
def of_even_light(sky, to_eye, rough):
    """Compute what a lobe reflects of light of 1 from everywhere; `rough` as `row_of_lobe` returns it."""
    row, below = rough
    at, over = _column(sky, to_eye)
    return _mixed(sky.lobes, row, below, at, over, 0, SHARE) + _mixed(sky.lobes, row, below, at, over, 1, SHARE)


@part
def mirror(sky, normal, view, rough, values, specular):
    """Add to specular [3] the light of a whole sky (`MirrorArrays`) in a lobe; returns that of light of 1.

    `values` [8] is a buffer; `rough` as `row_of_lobe` returns it.
    """
    along = normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]
    inverse = _1 / max(np.sqrt(max(_1 - along * along, _0)), _TINY)
    x, y, z = view[0] - along * normal[0], view[1] - along * normal[1], view[2] - along * normal[2]
    (row, below), (at, over), even = rough, _column(sky, -along), _0
    cell = np.intp(2 * _FOUR)
    line, nothing = np.intp(sky.lobes.shape[1]) * cell, np.intp(0)
    weights = (_1 - over) * (_1 - below), over * (_1 - below), (_1 - over) * below, over * below
    for half in range(2):
        first = np.intp(row) * line + np.intp(at) * cell + np.intp(half * _FOUR)
        blend_texels(sky.lobes, first, cell, line, nothing, weights, _0, values, nothing)
        ahead, up = values[AHEAD] * inverse, values[UP]
        even += values[SHARE]
        dx, dy, dz = ahead * x + up * normal[0], ahead * y + up * normal[1], ahead * z + up * normal[2]
        _add_around(sky, dx, dy, dz, values[WIDTH], values[SHARE], values, specular)
    return even


@part
def row_of_lobe(sky, alpha_squared):
    """Find the row of the table for a lobe, and how far below it lies."""
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
    """Interpolate a value of an isotropic lobe, bilinear in the table."""
    upper = (_1 - over) * lobes[row, at, half, value] + over * lobes[row, at + 1, half, value]
    lower = (_1 - over) * lobes[row + 1, at, half, value] + over * lobes[row + 1, at + 1, half, value]
    return (_1 - below) * upper + below * lower


@part
def _add_around(sky, x, y, z, width, share, values, light):
    """Add to light [3] a share of the mean around a direction."""
    u, v = on_square(x, y, z)
    half, wide = np.float32(sky.side // 2), sky.side + 2
    column, row = (u + _1) * half + _HALF, (v + _1) * half + _HALF
    left, top = min(max(np.int64(column), 0), sky.side), min(max(np.int64(row), 0), sky.side)
    right, below = column - np.float32(left), row - np.float32(top)
    level = min(np.int64(width), sky.radiance.shape[1] - 2)
    texel = np.intp(sky.radiance.shape[1] * _FOUR)
    first = np.intp(top * wide + left) * texel + np.intp(level * _FOUR)
    weights = (_1 - right) * (_1 - below), right * (_1 - below), (_1 - right) * below, right * below
    wider = width - np.float32(level)
    blend_texels(
        sky.radiance, first, texel, np.intp(wide) * texel, np.intp(_FOUR), weights, wider, values, np.intp(_FOUR)
    )
    for c in range(3):
        light[c] += share * values[_FOUR + c]
