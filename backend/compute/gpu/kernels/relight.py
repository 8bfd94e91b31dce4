"""The colours of the full-size image in a light: as `image.shading.shade_image`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....light.brdf import INDEX, LEAST_ROUGHNESS, NAIL_ROUGHNESS, ROUGHNESS, SKIN_ROUGHNESS
from ....light.lighting import SCATTERED_SCALE
from ....light.prefiltered_environment import SIDE
from .compiled import Floats, Floats2, Floats3, Floats4, Ints, Longs, Vectors, kernel, part
from .lobes import (
    TINY,
    bump_shadowing,
    clamped_reflection_normal,
    ggx,
    glossy_normal,
    horizon_occlusion,
    mirrored_light,
    of_even_light,
    share_above,
)
from .pixels import neighbours

_SCATTERED, _DIFFUSE, _GLOSS = wp.constant(3), wp.constant(9), wp.constant(12)
_SHALLOW_SCALE, _SQUARED_INDEX = wp.constant(SCATTERED_SCALE[1]), wp.constant(INDEX**2)
_TIGHT_ALPHA, _NAIL_ALPHA = wp.constant(ROUGHNESS[0] ** 2), wp.constant(NAIL_ROUGHNESS**2)
_SKIN_SQUARED = wp.constant(SKIN_ROUGHNESS**4)
_SIDE, _LEAST_ROUGHNESS = wp.constant(SIDE), wp.constant(LEAST_ROUGHNESS)


@part
@no_type_check
def _blended(light: Floats2, rays: wp.vec4i, shares: wp.vec4, column: int) -> float:
    value = wp.float32(0.0)
    for k in range(4):
        value += shares[k] * light[rays[k], column]
    return value


@part
@no_type_check
def _blended3(light: Floats2, rays: wp.vec4i, shares: wp.vec4, column: int) -> wp.vec3:
    return wp.vec3(
        _blended(light, rays, shares, column),
        _blended(light, rays, shares, column + 1),
        _blended(light, rays, shares, column + 2),
    )


@part
@no_type_check
def _of_colours(values: Floats2, index: int, first: int) -> wp.vec3:
    return wp.vec3(values[index, first], values[index, first + 1], values[index, first + 2])


@part
@no_type_check
def _bumped(normal: wp.vec3, towards: wp.vec3, along: float, surface_normal: wp.vec3) -> float:
    """Compute what a diffuse surface reflects of a light in a direction."""
    facing = wp.dot(towards, normal)
    reflected = wp.float32(0.0)
    if facing > 0.0:
        reflected = facing * bump_shadowing(facing, towards, along, surface_normal)
    return reflected


@kernel
@no_type_check
def relit_pixels(
    count: Ints,
    pixel: Longs,
    coefficients: Floats2,
    normal: Vectors,
    surface_normal: Vectors,
    blurred_normal: Vectors,
    alpha_squared: Floats,
    view: Vectors,
    shares: Floats2,
    light: Floats2,
    row: Ints,
    width: int,
    lamp_rgb: Vectors,
    lamp_radius_rad: Floats,
    nails: Floats,
    sharpness: Floats,
    radiance: Floats3,
    lobes: Floats4,
    out: Vectors,
):
    """Fill out [H * W] with the colours of pixels [P], premultiplied.

    `light` [R, C] are features: lamp vectors, sky vectors, the sky's seen shares, near-field specular light, scattered
    light, `arriving` and `reflected`. `row` [h * w] is the ray of a low-resolution pixel, -1 for none.
    """
    index = wp.tid()
    if index >= count[0]:
        return
    lamps = lamp_rgb.shape[0]
    sky_at = 3 * lamps
    visible_at = sky_at + 9
    near_at = sky_at + 11
    scattered_at = sky_at + 17
    arriving_at = sky_at + 23
    rays = neighbours(int(pixel[index]), width, row.shape[0] / width)
    around = wp.vec4()
    for k in range(4):
        if row[rays[k]] >= 0:
            around[k] = shares[index, k]
        rays[k] = wp.max(row[rays[k]], 0)
    bump = normal[index]
    away = view[index]
    surface = surface_normal[index]
    blurred = blurred_normal[index]
    nail = nails[index]
    along = wp.dot(bump, surface)
    along_blurred = wp.dot(blurred, surface)
    mirroring = clamped_reflection_normal(bump, surface, away, along)
    tight = _TIGHT_ALPHA + (_NAIL_ALPHA - _TIGHT_ALPHA) * nail
    squares = wp.vec2(tight * tight, alpha_squared[index])
    gloss = wp.vec2(coefficients[index, _GLOSS], coefficients[index, _GLOSS + 1])
    # An avatar's surface has the second lobe alone on skin, and the first on nails.
    of_tight = wp.vec4()
    of_broad = wp.vec4()
    if gloss[0] > 0.0 or nail > 0.0:
        of_tight = mirrored_light(radiance, lobes, _SIDE, _LEAST_ROUGHNESS, mirroring, away, squares[0])
    if gloss[1] > 0.0 or nail < 1.0:
        of_broad = mirrored_light(radiance, lobes, _SIDE, _LEAST_ROUGHNESS, mirroring, away, squares[1])
    # The first lobe on nails, the second on skin: what is reflected does not enter.
    of_lobes = of_broad[3] + nail * (of_tight[3] - of_broad[3])
    of_surface = of_even_light(lobes, -wp.dot(surface, away), squares[1], _LEAST_ROUGHNESS)
    if nail > 0.0:
        of_nail = of_even_light(lobes, -wp.dot(surface, away), squares[0], _LEAST_ROUGHNESS)
        of_surface += nail * (of_nail - of_surface)
    under = (1.0 - of_lobes) / (1.0 - of_surface)
    to_eye = -wp.dot(mirroring, away)
    above = wp.dot(surface, away) + 2.0 * to_eye * wp.dot(mirroring, surface)
    of_tight *= horizon_occlusion(above, to_eye, squares[0])
    of_broad *= horizon_occlusion(above, to_eye, squares[1])
    diffuse = _of_colours(coefficients, index, _DIFFUSE)
    deep = _of_colours(coefficients, index, _SCATTERED)
    shallow = _of_colours(coefficients, index, _SCATTERED + 3)
    visible_tight = _blended(light, rays, around, visible_at)
    visible_broad = _blended(light, rays, around, visible_at + 1)
    of_x = _blended3(light, rays, around, sky_at)
    of_y = _blended3(light, rays, around, sky_at + 3)
    of_z = _blended3(light, rays, around, sky_at + 6)
    near_tight = _blended3(light, rays, around, near_at)
    near_broad = _blended3(light, rays, around, near_at + 3)
    deep_light = _blended3(light, rays, around, scattered_at)
    rgb = wp.vec3()
    for c in range(3):
        from_sky = wp.vec3(of_x[c], of_y[c], of_z[c])
        sharp = wp.max(wp.dot(from_sky, bump), 0.0)
        wide = wp.max(wp.dot(from_sky, blurred), 0.0)
        rgb[c] = (
            diffuse[c] * (wide + sharpness[c] * (sharp - wide)) * under
            + deep[c] * deep_light[c] * under
            + gloss[0] * (visible_tight * of_tight[c] + near_tight[c])
            + gloss[1] * (visible_broad * of_broad[c] + near_broad[c])
        )
    relief = wp.vec3()
    steep = glossy_normal(bump, surface, along)
    steeper = clamped_reflection_normal(steep, surface, away, wp.dot(steep, surface))
    for lamp in range(lamps):
        arriving = _blended3(light, rays, around, 3 * lamp)
        strength = wp.max(wp.length(arriving), TINY)
        towards = arriving / strength
        sharp = _bumped(bump, towards, along, surface)
        wide = _bumped(blurred, towards, along_blurred, surface)
        rising = wp.dot(towards, surface)
        flat = wp.max(rising, 0.0)
        above = share_above(rising, lamp_radius_rad[lamp])
        specular = wp.float32(0.0)
        if above > 0.0:
            both = ggx(towards, steeper, away, lamp_radius_rad[lamp], squares, _SKIN_SQUARED, _SQUARED_INDEX)
            specular = strength * above * wp.dot(gloss, both)
        for c in range(3):
            bent = wide + sharpness[c] * (sharp - wide)
            rgb[c] += lamp_rgb[lamp][c] * (strength * diffuse[c] * bent * under + specular)
            relief[c] += lamp_rgb[lamp][c] * strength * (bent - flat)
    of_skin = gloss[0] * of_tight[3] + gloss[1] * of_broad[3]
    shallow_light = _blended3(light, rays, around, scattered_at + 3)
    arrives = _blended3(light, rays, around, arriving_at)
    reflected = _blended3(light, rays, around, arriving_at + 3)
    colour = wp.vec3()
    for c in range(3):
        # Light that enters a little deeper shows the relief, too.
        inside = wp.max(shallow_light[c] + _SHALLOW_SCALE * relief[c], 0.0)
        direct = rgb[c] + shallow[c] * inside * under
        colour[c] = direct * arrives[c] + (diffuse[c] + deep[c] + shallow[c] + of_skin) * reflected[c]
    out[int(pixel[index])] = colour
