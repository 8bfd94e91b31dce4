"""Light at points: as `light.lighting` and `light.indirect_diffuse.indirect_diffuse`."""

from __future__ import annotations

from math import pi
from typing import no_type_check

import warp as wp

from ....light.brdf import INDEX, ROUGHNESS
from ....light.lighting import BELOW_HORIZON, SCATTER_M, SCATTERED_SCALE, SKY_CELL_RAD, WRAP
from .compiled import Bools, Floats, Floats2, Floats3, Ints, Longs, Longs2, Vectors, Vectors2, kernel, part
from .lobes import GRAZING, LEAST_COSINE, TINY, fresnel, half_way, lobe, widened

_PI, _LEAST_SQUARED_M, _TOUCHING_SQUARED_M = wp.constant(pi), wp.constant(0.005**2), wp.constant(1e-8)
_LEAST_LENGTH, _LEAST_FACING, _NO_AREA = wp.constant(1e-12), wp.constant(1e-6), wp.constant(1e-20)
_DEEP_M, _SHALLOW_M = (wp.constant(value) for value in SCATTER_M)
_DEEP_WRAP, _SHALLOW_WRAP = (wp.constant(value) for value in WRAP)
_DEEP_SCALE, _SHALLOW_SCALE = (wp.constant(value) for value in SCATTERED_SCALE)
_TIGHT, _BROAD = (wp.constant(value * value) for value in ROUGHNESS)
_SQUARED_INDEX, _BELOW_HORIZON, _SKY_CELL_RAD = (wp.constant(v) for v in (INDEX**2, BELOW_HORIZON, SKY_CELL_RAD))


@part
@no_type_check
def _scattered(cosine: float, depth_in_m: float) -> wp.vec2:
    """Compute what arrives inside the skin, at both depths, of light of 1."""
    return wp.vec2(
        wp.max((cosine + _DEEP_WRAP) * _DEEP_SCALE, 0.0) * wp.exp(-depth_in_m / _DEEP_M),
        wp.max((cosine + _SHALLOW_WRAP) * _SHALLOW_SCALE, 0.0) * wp.exp(-depth_in_m / _SHALLOW_M),
    )


@kernel
@no_type_check
def sky_features(
    count: Ints,
    normal: Vectors,
    relief_normal: Vectors,
    view: Vectors,
    towards: Vectors,
    flux: Vectors,
    brightness: Floats,
    share: Floats,
    lit: Floats2,
    depth_in_m: Floats2,
    vectors: Vectors2,
    seen: Floats2,
    scattered: Vectors2,
):
    """Fill what the sky does at points [R]: vectors [R, 3 axes] RGB, shares [R, 2] of lobes, scattered [R, 2] RGB.

    Directions of no share are divided cells.
    """
    point = wp.tid()
    if point >= count[0]:
        return
    smooth = normal[point]
    relief = relief_normal[point]
    away = view[point]
    to_eye = wp.max(-wp.dot(relief, away), GRAZING)
    tight = widened(_TIGHT, _SKY_CELL_RAD)
    broad = widened(_BROAD, _SKY_CELL_RAD)
    of_x = wp.vec3()
    of_y = wp.vec3()
    of_z = wp.vec3()
    deep = wp.vec3()
    shallow = wp.vec3()
    visible_tight = wp.float32(0.0)
    visible_broad = wp.float32(0.0)
    all_tight = wp.float32(0.0)
    all_broad = wp.float32(0.0)
    for k in range(towards.shape[0]):
        if share[k] > 0.0:
            direction = towards[k]
            light = flux[k]
            open_share = lit[k, point]
            inside = _scattered(wp.dot(direction, smooth), depth_in_m[k, point])
            deep += inside[0] * light
            shallow += inside[1] * light
            facing = wp.dot(direction, relief)
            if facing > 0.0:
                of_x += open_share * direction[0] * light
                of_y += open_share * direction[1] * light
                of_z += open_share * direction[2] * light
            if facing > LEAST_COSINE:
                middle = half_way(direction, away)
                to_half = wp.clamp(wp.dot(relief, middle), 0.0, 1.0)
                reflectance = fresnel(wp.dot(direction, middle), _SQUARED_INDEX)
                one = lobe(to_half, facing, to_eye, tight, reflectance) * brightness[k]
                other = lobe(to_half, facing, to_eye, broad, reflectance) * brightness[k]
                all_tight += one
                all_broad += other
                visible_tight += one * open_share
                visible_broad += other * open_share
    vectors[point, 0] = of_x
    vectors[point, 1] = of_y
    vectors[point, 2] = of_z
    seen[point, 0] = visible_tight / wp.max(all_tight, TINY)
    seen[point, 1] = visible_broad / wp.max(all_broad, TINY)
    scattered[point, 0] = deep
    scattered[point, 1] = shallow


@part
@no_type_check
def emitted(
    along: float, is_area: bool, tan_spread: float, spread_share: float, cos_cone: float, cone_edge: float
) -> float:
    """Compute the intensity of a sample, per watt, in a direction with this cosine to its axis."""
    strength = wp.float32(0.0)
    if is_area:
        facing = wp.max(along, _LEAST_FACING)
        tangent = wp.sqrt(wp.max(1.0 / (facing * facing) - 1.0, 0.0))
        beam = wp.float32(1.0)
        if wp.isfinite(tan_spread):
            beam = wp.max((tan_spread - tangent) * spread_share, 0.0)
        strength = wp.max(along, 0.0) / _PI * beam
    else:
        edge = wp.clamp((along - cos_cone) * cone_edge, 0.0, 1.0)
        cone = wp.float32(1.0)
        if cos_cone >= -1.0:
            cone = edge * edge * (3.0 - 2.0 * edge)
        strength = cone / (4.0 * _PI)
    return strength


@part
@no_type_check
def arriving(
    place: wp.vec3,
    of_sample: wp.vec3,
    is_sun: bool,
    axis: wp.vec3,
    is_area: bool,
    share: float,
    tan_spread: float,
    spread_share: float,
    cos_cone: float,
    cone_edge: float,
) -> wp.vec4:
    """Compute the direction towards a sample of a lamp, and its strength at a place."""
    towards = of_sample
    strength = share
    if not is_sun:
        offset = of_sample - place
        squared = wp.max(wp.dot(offset, offset), _LEAST_SQUARED_M)
        towards = offset / wp.sqrt(squared)
        along = -wp.dot(towards, axis)
        strength = share / squared * emitted(along, is_area, tan_spread, spread_share, cos_cone, cone_edge)
    return wp.vec4(towards[0], towards[1], towards[2], strength)


@kernel
@no_type_check
def add_lamps(
    count: Ints,
    position: Vectors,
    normal: Vectors,
    relief_normal: Vectors,
    lamp: Longs,
    of_sample: Vectors,
    is_sun: Bools,
    axis: Vectors,
    is_area: Bools,
    share: Floats,
    tan_spread: Floats,
    spread_share: Floats,
    cos_cone: Floats,
    cone_edge: Floats,
    shadow: Floats,
    rgb: Vectors,
    lit: Floats2,
    depth_in_m: Floats2,
    vectors: Vectors2,
    scattered: Vectors2,
):
    """Fill what the samples of lamps do at points [R]: vectors [R, L]; and add to scattered [R, 2] RGB.

    Samples are as `light.lamp_samples.LampSamples`: those of a lamp lie side by side.
    """
    point = wp.tid()
    if point >= count[0]:
        return
    deep = wp.vec3()
    shallow = wp.vec3()
    for of_lamp in range(rgb.shape[0]):
        vectors[point, of_lamp] = wp.vec3()
    for k in range(lamp.shape[0]):
        light = arriving(
            position[point],
            of_sample[k],
            is_sun[k],
            axis[k],
            is_area[k],
            share[k],
            tan_spread[k],
            spread_share[k],
            cos_cone[k],
            cone_edge[k],
        )
        towards = wp.vec3(light[0], light[1], light[2])
        strength = light[3]
        of_lamp = int(lamp[k])
        inside = _scattered(wp.dot(towards, normal[point]), shadow[k] * depth_in_m[k, point])
        deep += inside[0] * strength * rgb[of_lamp]
        shallow += inside[1] * strength * rgb[of_lamp]
        if wp.dot(towards, relief_normal[point]) > _BELOW_HORIZON:
            unblocked = strength * (shadow[k] * lit[k, point] + (1.0 - shadow[k]))
            vectors[point, of_lamp] = vectors[point, of_lamp] + unblocked * towards
    scattered[point, 0] = scattered[point, 0] + deep
    scattered[point, 1] = scattered[point, 1] + shallow


@kernel
@no_type_check
def ambient_occlusion(towards: Vectors, normal: Vectors, lit: Floats2, share: Floats, mean: Vectors):
    """Fill share [R] and mean [R] of points as `light.lighting.ambient_occlusion`."""
    point = wp.tid()
    total = wp.float32(0.0)
    sum_of = wp.vec3()
    for k in range(towards.shape[0]):
        weight = lit[k, point] * wp.max(wp.dot(towards[k], normal[point]), 0.0)
        total += weight
        sum_of += weight * towards[k]
    share[point] = total * (4.0 / float(towards.shape[0]))
    mean[point] = sum_of / wp.max(wp.length(sum_of), _LEAST_LENGTH)


@part
@no_type_check
def form_factor(offset: wp.vec3, normal: wp.vec3, surfel_normal: wp.vec3, area_m2: float) -> float:
    """Compute the form factor of a surfel at an offset from a point of this normal."""
    squared = wp.dot(offset, offset)
    facing = wp.max(wp.dot(offset, normal), 0.0)
    there = wp.max(-wp.dot(offset, surfel_normal), 0.0)
    return facing * there * area_m2 / (wp.max(squared, _TOUCHING_SQUARED_M) * (_PI * squared + area_m2))


@kernel
@no_type_check
def add_surfels(
    position: Vectors,
    normal: Vectors,
    of_surfel: Vectors,
    surfel_normal: Vectors,
    area_m2: Floats,
    radiance: Vectors,
    parts: int,
    sums: Floats3,
):
    """Fill sums [R, parts, 4] of form factors times radiance, and of form factors, of every so many surfels."""
    point, first = wp.tid()
    here = position[point]
    received = wp.vec3()
    total = wp.float32(0.0)
    k = int(first)
    while k < area_m2.shape[0]:
        factor = form_factor(of_surfel[k] - here, normal[point], surfel_normal[k], area_m2[k])
        total += factor
        received += factor * radiance[k]
        k += parts
    for colour in range(3):
        sums[point, first, colour] = received[colour]
    sums[point, first, 3] = total


@kernel
@no_type_check
def sum_surfels(sums: Floats3, received: Vectors):
    """Fill what points receive, from the sums of their parts in order."""
    point = wp.tid()
    light = wp.vec3()
    total = wp.float32(0.0)
    for index in range(sums.shape[1]):
        light += wp.vec3(sums[point, index, 0], sums[point, index, 1], sums[point, index, 2])
        total += sums[point, index, 3]
    received[point] = light / wp.max(total, 1.0)


@part
@no_type_check
def barycentric_on(vertices: Vectors, faces: Longs2, face: int, place: wp.vec3) -> wp.vec3:
    """Compute the weights of a face's corners at a point near it, as `MeshPoints.of`; face -1 is none, and has none."""
    of_face = wp.max(face, 0)
    a = vertices[int(faces[of_face, 0])]
    b = vertices[int(faces[of_face, 1])]
    c = vertices[int(faces[of_face, 2])]
    normal = wp.cross(b - a, c - a)
    areas = wp.vec3(
        wp.max(wp.dot(wp.cross(c - b, place - b), normal), 0.0),
        wp.max(wp.dot(wp.cross(a - c, place - c), normal), 0.0),
        wp.max(wp.dot(wp.cross(b - a, place - a), normal), 0.0),
    )
    if face < 0:
        areas = wp.vec3()
    return areas / wp.max(areas[0] + areas[1] + areas[2], _NO_AREA)


@kernel
@no_type_check
def mesh_points(vertices: Vectors, faces: Longs2, face: Longs, position: Vectors, corner: Longs2, weight: Floats2):
    """Fill corners and weights [R, 3] of points near faces as `MeshPoints.of`; face -1 is none."""
    point = wp.tid()
    shares = barycentric_on(vertices, faces, int(face[point]), position[point])
    for k in range(3):
        corner[point, k] = faces[int(wp.max(face[point], wp.int64(0))), k]
        weight[point, k] = shares[k]
