"""Light of nearby geometry: as `light.near_field_light`."""

from __future__ import annotations

from math import pi
from typing import no_type_check

import warp as wp

from ....light.brdf import INDEX, ROUGHNESS
from ....light.lighting import SCATTERED_SCALE, WRAP
from ....light.near_field_light import CELLS
from .compiled import Floats, Floats2, Floats3, Ints, Longs2, Vectors, Vectors2, kernel, part
from .lobes import ggx, on_square

_PI, _LEAST_M, _CELLS = wp.constant(pi), wp.constant(0.001), wp.constant(CELLS)
_DEEP_WRAP, _SHALLOW_WRAP = (wp.constant(value) for value in WRAP)
_DEEP_SCALE, _SHALLOW_SCALE = (wp.constant(value) for value in SCATTERED_SCALE)
_TIGHT_SQUARED, _BROAD_SQUARED = (wp.constant(value**4) for value in ROUGHNESS)
_SQUARED_INDEX, _NO_BUMPS = wp.constant(INDEX**2), wp.constant(1.0)


@part
@no_type_check
def _cell_of(towards: wp.vec3) -> int:
    """Find the cell of a direction on the octahedral map."""
    place = on_square(towards)
    column = wp.clamp(int((place[0] + 1.0) * float(_CELLS) / 2.0), 0, _CELLS - 1)
    row = wp.clamp(int((place[1] + 1.0) * float(_CELLS) / 2.0), 0, _CELLS - 1)
    return row * _CELLS + column


@part
@no_type_check
def _open_factor(at: wp.vec3, position: wp.vec3, normal: wp.vec3, area_m2: float) -> wp.vec4:
    """Compute the unit direction to a patch, and its form factor without the point's own cosine."""
    offset = position - at
    distance = wp.max(wp.length(offset), _LEAST_M)
    towards = offset / distance
    there = wp.max(-wp.dot(towards, normal), 0.0)
    return wp.vec4(towards[0], towards[1], towards[2], there * area_m2 / (_PI * distance * distance + area_m2))


@part
@no_type_check
def _factor(
    at: wp.vec3,
    point: int,
    patch: int,
    position: Vectors,
    normal: Vectors,
    area_m2: Floats,
    open_sky: Floats2,
    sky_cell: Longs2,
    sky_weight: Floats2,
) -> wp.vec4:
    """Compute the unit direction to a patch, and its form factor past the hand without the point's own cosine."""
    found = _open_factor(at, position[patch], normal[patch], area_m2[patch])
    cell = _cell_of(wp.vec3(found[0], found[1], found[2]))
    share = wp.float32(0.0)
    for near in range(sky_cell.shape[1]):
        share += open_sky[int(sky_cell[cell, near]), point] * sky_weight[cell, near]
    return wp.vec4(found[0], found[1], found[2], found[3] * share)


@kernel
@no_type_check
def light_of_patches(
    of_points: Vectors,
    share: Floats,
    start: Ints,
    albedo: Vectors,
    sums: Floats3,
    first: Vectors,
    of_hand: Vectors,
):
    """Fill what patches [P] reflect of lamps and sky, and the light that they receive of the hand.

    `of_points` is what their points receive, each patch's from `start` on, and `share` of its area; `sums` are as
    `features.add_surfels` gives them.
    """
    patch = wp.tid()
    received = wp.vec3()
    for point in range(start[patch], start[patch + 1]):
        received += share[point] * of_points[point]
    first[patch] = wp.cw_mul(albedo[patch], received)
    light = wp.vec3()
    total = wp.float32(0.0)
    for index in range(sums.shape[1]):
        light += wp.vec3(sums[patch, index, 0], sums[patch, index, 1], sums[patch, index, 2])
        total += sums[patch, index, 3]
    of_hand[patch] = light / wp.max(total, 1.0)


@kernel
@no_type_check
def share_among_patches(
    patches: Ints,
    position: Vectors,
    normal: Vectors,
    area_m2: Floats,
    albedo: Vectors,
    first: Vectors,
    of_hand: Vectors,
    emitted: Vectors,
):
    """Fill the radiance of patches [P] after one exchange among them, as `near_field_light.PatchIrradiance.emitted`.

    `patches` [1] is how many there are.
    """
    patch = wp.tid()
    if patch >= patches[0]:
        return
    light = wp.vec3()
    total = wp.float32(0.0)
    for k in range(patches[0]):
        found = _open_factor(position[patch], position[k], normal[k], area_m2[k])
        factor = found[3] * wp.max(wp.dot(wp.vec3(found[0], found[1], found[2]), normal[patch]), 0.0)
        total += factor
        light += factor * first[k]
    received = light / wp.max(total, 1.0) + of_hand[patch]
    emitted[patch] = first[patch] + wp.cw_mul(albedo[patch], received)


@kernel
@no_type_check
def reflect_on_surfels(
    at: Vectors,
    facing: Vectors,
    albedo: Vectors,
    patches: Ints,
    position: Vectors,
    normal: Vectors,
    area_m2: Floats,
    emitted: Vectors,
    open_sky: Floats2,
    sky_cell: Longs2,
    sky_weight: Floats2,
    radiance: Vectors,
):
    """Add what surfels [V] reflect of patches [P] to their radiance; arguments as of `near_field_light`."""
    surfel = wp.tid()
    light = wp.vec3()
    total = wp.float32(0.0)
    for k in range(patches[0]):
        found = _factor(at[surfel], surfel, k, position, normal, area_m2, open_sky, sky_cell, sky_weight)
        factor = found[3] * wp.max(wp.dot(wp.vec3(found[0], found[1], found[2]), facing[surfel]), 0.0)
        total += factor
        light += factor * emitted[k]
    radiance[surfel] = radiance[surfel] + wp.cw_mul(albedo[surfel], light / wp.max(total, 1.0))


@kernel
@no_type_check
def near_field_light(
    count: Ints,
    at: Vectors,
    smooth: Vectors,
    relief: Vectors,
    view: Vectors,
    patches: Ints,
    position: Vectors,
    normal: Vectors,
    area_m2: Floats,
    emitted: Vectors,
    open_sky: Floats2,
    sky_cell: Longs2,
    sky_weight: Floats2,
    vectors: Vectors2,
    specular: Vectors2,
    scattered: Vectors2,
):
    """Add what points [R] receive of patches [P] to vectors and scattered light, and fill specular light.

    `patches` [1] is how many there are, and `open_sky` [K, R] where the hand alone leaves the sky open.
    """
    point = wp.tid()
    if point >= count[0]:
        return
    here = at[point]
    total = wp.float32(0.0)
    for k in range(patches[0]):
        found = _factor(here, point, k, position, normal, area_m2, open_sky, sky_cell, sky_weight)
        total += found[3] * wp.max(wp.dot(wp.vec3(found[0], found[1], found[2]), relief[point]), 0.0)
    scale = 1.0 / wp.max(total, 1.0)
    of_x = wp.vec3()
    of_y = wp.vec3()
    of_z = wp.vec3()
    tight = wp.vec3()
    broad = wp.vec3()
    deep = wp.vec3()
    shallow = wp.vec3()
    squares = wp.vec2(_TIGHT_SQUARED, _BROAD_SQUARED)
    for k in range(patches[0]):
        found = _factor(here, point, k, position, normal, area_m2, open_sky, sky_cell, sky_weight)
        towards = wp.vec3(found[0], found[1], found[2])
        light = (found[3] * scale) * emitted[k]
        around = wp.dot(towards, smooth[point])
        deep += wp.max(around + _DEEP_WRAP, 0.0) * _DEEP_SCALE * light
        shallow += wp.max(around + _SHALLOW_WRAP, 0.0) * _SHALLOW_SCALE * light
        if wp.dot(towards, relief[point]) > 0.0:
            of_x += towards[0] * light
            of_y += towards[1] * light
            of_z += towards[2] * light
            distance = wp.max(wp.length(position[k] - here), _LEAST_M)
            radius_rad = wp.sqrt(area_m2[k] / _PI) / distance
            both = ggx(towards, relief[point], view[point], radius_rad, squares, _NO_BUMPS, _SQUARED_INDEX)
            tight += both[0] * light
            broad += both[1] * light
    vectors[point, 0] = vectors[point, 0] + of_x
    vectors[point, 1] = vectors[point, 1] + of_y
    vectors[point, 2] = vectors[point, 2] + of_z
    specular[point, 0] = tight
    specular[point, 1] = broad
    scattered[point, 0] = scattered[point, 0] + deep
    scattered[point, 1] = scattered[point, 1] + shallow
