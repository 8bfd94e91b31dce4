"""The specular lobes and how a bump changes them: as `light.brdf` and `light.prefiltered_environment`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....light.brdf import FACES_TURN, POSITIVE_PART, STEEPER, TAIL
from .compiled import Floats3, Floats4, part

LEAST_COSINE, GRAZING, TINY = wp.constant(1e-4), wp.constant(0.05), wp.constant(1e-8)
_LEAST_MIRRORED, _LEAST_OF_EYE, _LEAST_BEND = wp.constant(0.01), wp.constant(0.9), wp.constant(1e-4)
_LEAST_LENGTH = wp.constant(1e-12)
_TAIL, _FACES_TURN, _POSITIVE_PART = wp.constant(TAIL), wp.constant(FACES_TURN), wp.constant(POSITIVE_PART)
_STEEPER = wp.constant(STEEPER)
SHARE, AHEAD, UP, WIDTH = (wp.constant(value) for value in range(4))


@part
@no_type_check
def widened(alpha: float, light_radius_rad: float) -> float:
    """Return the squared alpha of a lobe, widened by the light."""
    return wp.min(alpha * alpha + light_radius_rad * light_radius_rad * 0.25, 1.0)


@part
@no_type_check
def fresnel(cosine: float, squared_index: float) -> float:
    """Compute the reflected share, as `light.brdf.fresnel`."""
    c = wp.clamp(cosine, 0.0, 1.0)
    inside = wp.sqrt(squared_index - 1.0 + c * c)
    less = inside - c
    more = inside + c
    straight = less / more
    aside = (c * more - 1.0) / (c * less + 1.0)
    return 0.5 * straight * straight * (1.0 + aside * aside)


@part
@no_type_check
def lobe(to_half: float, to_light: float, to_eye: float, squared: float, reflectance: float) -> float:
    """Compute what one lobe reflects: GGX with correlated shadowing, times the cosine to the light."""
    return _masked(to_half, to_light, to_eye, squared, squared) * reflectance


@part
@no_type_check
def _masked(to_half: float, to_light: float, to_eye: float, squared: float, smooth: float) -> float:
    """Compute a lobe without Fresnel; by `smooth`, a squared alpha, too, it shadows and masks itself."""
    base = to_half * to_half * (squared - 1.0) + 1.0
    shadowing = to_light * wp.sqrt(to_eye * to_eye * (1.0 - smooth) + smooth) + to_eye * wp.sqrt(
        to_light * to_light * (1.0 - smooth) + smooth
    )
    return squared / (base * base) * 0.5 / shadowing * to_light


@part
@no_type_check
def _over_bumps(
    to_half: float, to_light: float, to_eye: float, along_half: float, squared: float, hidden: float
) -> float:
    """Compute a lobe without Fresnel; `hidden`: the variance of slopes of bumps in its squared alpha."""
    facing = to_half * to_half
    across = 1.0 - facing
    towards_half = hidden * to_half / (squared * facing + across)
    inverse = 1.0 / wp.sqrt(1.0 + towards_half * towards_half * across)
    kept = (1.0 - towards_half * to_half) * inverse
    added = towards_half * along_half * inverse
    mean = kept * to_light + added
    variance = 0.5 * hidden * (1.0 - towards_half) * wp.max(1.0 - mean * mean, 0.0)
    light = wp.max(0.5 * (mean + wp.sqrt(mean * mean + _POSITIVE_PART * variance)), LEAST_COSINE)
    eye = wp.max(kept * to_eye + added, GRAZING)
    reach = _TAIL * squared * facing
    return _masked(
        to_half, light, eye, squared - hidden + hidden * reach / wp.max(reach + across, TINY), squared - hidden
    )


@part
@no_type_check
def half_way(towards: wp.vec3, view: wp.vec3) -> wp.vec3:
    """Compute the unit direction between light and eye."""
    between = towards - view
    return between / wp.max(wp.length(between), TINY)


@part
@no_type_check
def ggx(
    towards: wp.vec3,
    normal: wp.vec3,
    view: wp.vec3,
    radius_rad: float,
    squares: wp.vec2,
    skin_squared: float,
    index: float,
) -> wp.vec2:
    """Compute both lobes for a light in a direction.

    `squares`: their squared alphas, beyond `skin_squared` by hidden bumps in the second; `index`: squared.
    """
    middle = half_way(towards, view)
    to_eye = -wp.dot(normal, view)
    to_half = wp.clamp(wp.dot(normal, middle), 0.0, 1.0)
    along_half = wp.clamp(wp.dot(towards, middle), 0.0, 1.0)
    to_light = wp.dot(normal, towards)
    wider = radius_rad * radius_rad * 0.25
    tight = wp.min(squares[0] + wider, 1.0)
    broad = wp.min(squares[1] + wider, 1.0)
    hidden = wp.max(squares[1] - skin_squared, 0.0)
    flat = wp.float32(0.0)
    bumpy = wp.float32(0.0)
    if to_light > 0.0:
        flat = _masked(to_half, wp.max(to_light, LEAST_COSINE), wp.max(to_eye, GRAZING), tight, tight)
    if to_light > 0.0 or hidden > 0.0:
        bumpy = _over_bumps(to_half, to_light, to_eye, along_half, broad, hidden)
    return wp.vec2(flat, bumpy) * fresnel(along_half, index)


@part
@no_type_check
def share_above(to_light: float, light_radius_rad: float) -> float:
    """Compute the share of a light above a surface, by the cosine of its middle and the surface's normal."""
    return wp.clamp(0.5 + 0.5 * to_light / (_FACES_TURN + light_radius_rad), 0.0, 1.0)


@part
@no_type_check
def bump_shadowing(facing: float, towards: wp.vec3, along: float, surface_normal: wp.vec3) -> float:
    """Compute the share of a light of cosine `facing`; `along`: cosine of both normals."""
    share = wp.clamp(wp.dot(towards, surface_normal) / wp.max(facing * along, TINY), 0.0, 1.0)
    return share * (1.0 + share - share * share)


@part
@no_type_check
def horizon_occlusion(above: float, to_eye: float, alpha_squared: float) -> float:
    """Compute a lobe's share; `above`: cosine of mirrored view and surface's normal, `to_eye`: and the bump's own."""
    return wp.min(_part_of_lobe(above, alpha_squared) / _part_of_lobe(wp.max(to_eye, 0.0), alpha_squared), 1.0)


@part
@no_type_check
def _part_of_lobe(cosine: float, alpha_squared: float) -> float:
    tangent = cosine / (1.0 + wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0)))
    return 1.0 + tangent / wp.sqrt(alpha_squared + tangent * tangent)


@part
@no_type_check
def clamped_reflection_normal(normal: wp.vec3, surface_normal: wp.vec3, view: wp.vec3, along: float) -> wp.vec3:
    """Bend a normal back towards the surface's as `light.brdf`; `along`: cosine of both normals."""
    up = -wp.dot(surface_normal, view)
    facing = -wp.dot(normal, view)
    least = wp.min(_LEAST_OF_EYE * up, _LEAST_MIRRORED)
    bend = wp.sqrt(wp.max(1.0 - along * along, 0.0))
    bent = normal
    if up > 0.0 and 2.0 * facing * along - up < least and bend > _LEAST_BEND:
        aside = (facing - along * up) / bend
        reach = wp.acos(wp.min(least / wp.max(wp.sqrt(up * up + aside * aside), TINY), 1.0))
        kept = 0.5 * (wp.atan2(aside, up) + reach)
        bent = wp.cos(kept) * surface_normal + wp.sin(kept) / bend * (normal - along * surface_normal)
    return bent


@part
@no_type_check
def glossy_normal(normal: wp.vec3, surface_normal: wp.vec3, along: float) -> wp.vec3:
    """Bend a normal away from the surface's as `light.brdf`; `along`: cosine of both normals."""
    bent = _STEEPER * normal - (_STEEPER - 1.0) * along * surface_normal
    return bent / wp.max(wp.length(bent), TINY)


@part
@no_type_check
def on_square(towards: wp.vec3) -> wp.vec2:
    """Map a direction of any length but 0 to (u, v) in [-1, 1]."""
    total = wp.abs(towards[0]) + wp.abs(towards[1]) + wp.abs(towards[2])
    u = towards[0] / total
    v = towards[1] / total
    place = wp.vec2(u, v)
    if towards[2] < 0.0:
        place = wp.vec2(_with_sign(1.0 - wp.abs(v), u), _with_sign(1.0 - wp.abs(u), v))
    return place


@part
@no_type_check
def _with_sign(size: float, sign: float) -> float:
    signed = size
    if wp.cast(sign, wp.int32) < 0:
        signed = -size
    return signed


@part
@no_type_check
def isotropic_lobe(lobes: Floats4, to_eye: float, alpha_squared: float, half: int, least_roughness: float) -> wp.vec4:
    """Look up one of the two isotropic lobes: its share, direction ahead and up, and width."""
    rows = lobes.shape[0] - 1
    columns = lobes.shape[1] - 1
    rough = (wp.sqrt(wp.sqrt(alpha_squared)) - least_roughness) / (1.0 - least_roughness)
    down = wp.clamp(rough, 0.0, 1.0) * float(rows)
    row = wp.min(int(down), rows - 1)
    below = down - float(row)
    over = wp.sqrt(1.0 - wp.clamp(to_eye, 0.0, 1.0)) * float(columns)
    at = wp.min(int(over), columns - 1)
    right = over - float(at)
    found = wp.vec4()
    for value in range(4):
        upper = (1.0 - right) * lobes[row, at, half, value] + right * lobes[row, at + 1, half, value]
        lower = (1.0 - right) * lobes[row + 1, at, half, value] + right * lobes[row + 1, at + 1, half, value]
        found[value] = (1.0 - below) * upper + below * lower
    return found


@part
@no_type_check
def of_even_light(lobes: Floats4, to_eye: float, alpha_squared: float, least_roughness: float) -> float:
    """Compute what a lobe reflects of light of 1 from everywhere."""
    one = isotropic_lobe(lobes, to_eye, alpha_squared, 0, least_roughness)
    other = isotropic_lobe(lobes, to_eye, alpha_squared, 1, least_roughness)
    return one[SHARE] + other[SHARE]


@part
@no_type_check
def mirrored_light(
    radiance: Floats3,
    lobes: Floats4,
    side: int,
    least_roughness: float,
    normal: wp.vec3,
    view: wp.vec3,
    alpha_squared: float,
) -> wp.vec4:
    """Compute the light of a whole sky in a lobe, RGB, and that of light of 1 from everywhere."""
    along = wp.dot(normal, view)
    inverse = 1.0 / wp.max(wp.sqrt(wp.max(1.0 - along * along, 0.0)), _LEAST_LENGTH)
    ahead = (view - along * normal) * inverse
    light = wp.vec4()
    for half in range(2):
        found = isotropic_lobe(lobes, -along, alpha_squared, half, least_roughness)
        around = _light_around(radiance, side, found[AHEAD] * ahead + found[UP] * normal, found[WIDTH])
        light += found[SHARE] * wp.vec4(around[0], around[1], around[2], 1.0)
    return light


@part
@no_type_check
def _light_around(radiance: Floats3, side: int, towards: wp.vec3, width: float) -> wp.vec3:
    """Look up the mean light around a direction in a lobe of a width, bilinear in the map."""
    place = on_square(towards)
    half = float(side / 2)
    column = (place[0] + 1.0) * half + 0.5
    row = (place[1] + 1.0) * half + 0.5
    left = wp.clamp(int(wp.floor(column)), 0, side)
    top = wp.clamp(int(wp.floor(row)), 0, side)
    right = column - float(left)
    below = row - float(top)
    level = wp.clamp(int(width), 0, radiance.shape[1] - 2)
    wider = width - float(level)
    at = top * (side + 2) + left
    upper = (1.0 - right) * _texel(radiance, at, level, wider) + right * _texel(radiance, at + 1, level, wider)
    at += side + 2
    lower = (1.0 - right) * _texel(radiance, at, level, wider) + right * _texel(radiance, at + 1, level, wider)
    return (1.0 - below) * upper + below * lower


@part
@no_type_check
def _texel(radiance: Floats3, at: int, level: int, wider: float) -> wp.vec3:
    texel = wp.vec3()
    for colour in range(3):
        texel[colour] = (1.0 - wider) * radiance[at, level, colour] + wider * radiance[at, level + 1, colour]
    return texel
