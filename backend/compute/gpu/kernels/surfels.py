"""What the skin receives and reflects: as `light.lighting.irradiance_at_surfels` and `light.indirect_diffuse`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from .compiled import Bools, Floats, Floats2, Ints, Longs, Longs2, Vectors, kernel, part
from .features import arriving, form_factor


@kernel
@no_type_check
def surfel_radiance(
    position: Vectors,
    normal: Vectors,
    albedo: Vectors,
    towards: Vectors,
    flux: Vectors,
    sky_lit: Floats2,
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
    lamp_lit: Floats2,
    radiance: Vectors,
):
    """Fill the radiance of surfels [P] in the light of a sky and of lamps' samples."""
    surfel = wp.tid()
    received = wp.vec3()
    for k in range(towards.shape[0]):
        received += sky_lit[k, surfel] * wp.max(wp.dot(towards[k], normal[surfel]), 0.0) * flux[k]
    for k in range(lamp.shape[0]):
        light = arriving(
            position[surfel],
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
        direction = wp.vec3(light[0], light[1], light[2])
        facing = wp.max(wp.dot(direction, normal[surfel]), 0.0)
        lit = shadow[k] * lamp_lit[k, surfel] + (1.0 - shadow[k])
        received += light[3] * lit * facing * rgb[int(lamp[k])]
    radiance[surfel] = wp.cw_mul(albedo[surfel], received)


@part
@no_type_check
def _received_at(
    place: wp.vec3, facing: wp.vec3, of_surfel: Vectors, surfel_normal: Vectors, area_m2: Floats, radiance: Vectors
) -> wp.vec3:
    received = wp.vec3()
    total = wp.float32(0.0)
    for k in range(area_m2.shape[0]):
        factor = form_factor(of_surfel[k] - place, facing, surfel_normal[k], area_m2[k])
        total += factor
        received += factor * radiance[k]
    return received / wp.max(total, 1.0)


@kernel
@no_type_check
def reflect_on_rays(
    count: Ints,
    corner: Longs2,
    weight: Floats2,
    position: Vectors,
    normal: Vectors,
    of_surfel: Vectors,
    surfel_normal: Vectors,
    area_m2: Floats,
    radiance: Vectors,
    received: Vectors,
    reflected: Vectors,
):
    """Fill the indirect diffuse light of rays [R] as `indirect_diffuse_on_mesh`, from that of the mesh's vertices."""
    ray = wp.tid()
    if ray >= count[0]:
        return
    light = wp.vec3()
    total = wp.float32(0.0)
    for k in range(3):
        light += weight[ray, k] * received[int(corner[ray, k])]
        total += weight[ray, k]
    if total == 0.0:
        light = _received_at(position[ray], normal[ray], of_surfel, surfel_normal, area_m2, radiance)
    reflected[ray] = light
