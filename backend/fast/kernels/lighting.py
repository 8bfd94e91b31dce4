"""Equals `light_features` and `openness` of `nerf.lighting`, and `bounced`.

Of `nerf.relighting`: `detailed`, `smoothed_rays`, `shares_of_rays`, `normals_at_steps`, `relit`; and `surface_means`.
"""

from __future__ import annotations

from math import pi

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part

_0, _QUARTER, _HALF, _3Q, _1, _2, _3, _4 = (np.float32(value) for value in (0, 0.25, 0.5, 0.75, 1, 2, 3, 4))
_PI, _TINY, _LEAST_SQUARED_M = np.float32(pi), np.float32(1e-8), np.float32(0.005**2)
_16, _SIXTH, _24TH = (np.float32(value) for value in (16, 1 / 6, 1 / 24))
_LEAST_PROBE_SQUARED_M, _LEAST_LENGTH = np.float32(1e-8), np.float32(1e-12)
_LEAST_COSINE, _LEAST_FACING, _GRAZING = np.float32(1e-4), np.float32(1e-6), np.float32(0.05)
LEAST_SHARE, OF_PIXEL, OF_NEXT = (np.float32(value) for value in (0.01, 0.5, 0.125))
"""As in `nerf.relighting`."""
SCATTERED, DIFFUSE, GLOSS = 3, 9, 12
"""Where these begin among the coefficients."""
BLOCK = 64
"""Points whose light is computed at once."""
# Rows of a block, and of its sums.
_NORMAL, _RELIEF, _VIEW, _TO_EYE, _EYE_TERM, _FACING, _ARRIVING, _VALUE = 0, 3, 6, 9, 10, 12, 13, 14
_POSITION, _TOWARDS, _ROWS = 15, 18, 21
_SCATTERED, _VECTORS, _GLOSS, _SUMS = 0, 6, 15, 21


@compiled
def light_features(points, sky, lamps, probes, lobes, first, last, out):
    """Fill the features of points [first, last) (`FeatureArrays`)."""
    work, sums = np.empty((_ROWS, BLOCK), np.float32), np.empty((_SUMS, BLOCK), np.float32)
    vectors, factors = np.empty((3 * len(lamps.rgb), BLOCK), np.float32), np.empty(probes.shed.shape[1], np.float32)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        _load(points, lobes, start, count, work)
        sums[:], vectors[:] = _0, _0
        for k in range(len(sky.towards)):
            _add_direction(sky, lobes, k, start, count, work, sums)
        for k in range(len(lamps.lamp)):
            _add_lamp(lamps, lobes, k, start, count, work, sums, vectors)
        _store(start, count, sums, vectors, out)
    for point in range(first, last):
        _fill_factors(points.position[point], points.normal[point], probes, factors)
        _add_shed(factors, probes.shed, out.reflected[point])


@compiled
def openness(towards, normal, lit, first, last, share, mean):
    """Fill share [R] and mean [R, 3] of points [first, last) as `nerf.lighting.openness`; the normals are [3, R]."""
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
def _fill_factors(position, normal, probes, factors):
    """The form factors of a point and all probes; apart from their sums, so that this becomes vector instructions."""
    x, y, z, area_m2 = position[0], position[1], position[2], probes.area_m2
    nx, ny, nz = normal[0], normal[1], normal[2]
    for k in range(np.uintp(len(factors))):
        dx, dy, dz = probes.position[0, k] - x, probes.position[1, k] - y, probes.position[2, k] - z
        squared = dx * dx + dy * dy + dz * dz
        here = max(dx * nx + dy * ny + dz * nz, _0)
        there = max(-(dx * probes.normal[0, k] + dy * probes.normal[1, k] + dz * probes.normal[2, k]), _0)
        factors[k] = here * there * area_m2 / (max(squared, _LEAST_PROBE_SQUARED_M) * (_PI * squared + area_m2))


@part
def _add_shed(factors, shed, out):
    """Add to out [3] what arrives by these form factors."""
    total, red, green, blue = _0, _0, _0, _0
    for k in range(np.uintp(len(factors))):
        factor = factors[k]
        total += factor
        red += factor * shed[0, k]
        green += factor * shed[1, k]
        blue += factor * shed[2, k]
    most = max(total, _1)
    out[0] += red / most
    out[1] += green / most
    out[2] += blue / most


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
        to_eye = max(to_eye, _GRAZING)
        work[_TO_EYE, index] = to_eye
        for lobe in range(2):
            squared = _squared(lobes.alpha[lobe], lobes.sky_cell_rad)
            work[_EYE_TERM + lobe, index] = np.sqrt(to_eye * to_eye * (_1 - squared) + squared)


@part
def _squared(alpha, light_radius_rad):
    """Squared alpha of a lobe, widened by the light."""
    return min(alpha * alpha + light_radius_rad * light_radius_rad * _QUARTER, _1)


@part
def _add_direction(sky, lobes, k, start, count, work, sums):
    """Add one direction of the sky to a block. Short loops over few rows each, which become vector instructions."""
    depth = sky.depth_in_m[k, start : start + count]
    lit = sky.lit[k, start : start + count]
    for layer in range(2):
        _scatter_row(sky.towards[k], lobes.wrap[layer], lobes.scatter_m[layer], depth, work, work[_VALUE])
        for c in range(3):
            _add_row(sums[_SCATTERED + 3 * layer + c], work[_VALUE], sky.flux[k, c], count)
    _arriving_row(sky.towards[k], lit, work, work[_ARRIVING])
    for axis in range(3):
        for c in range(3):
            _add_row(sums[_VECTORS + 3 * axis + c], work[_ARRIVING], sky.towards[k, axis] * sky.flux[k, c], count)
    for lobe in range(2):
        squared = _squared(lobes.alpha[lobe], lobes.sky_cell_rad)
        _lobe_row(sky.towards[k], lobes.f0, squared, count, work[_EYE_TERM + lobe], work, work[_VALUE])
        for c in range(3):
            _add_row(sums[_GLOSS + 3 * lobe + c], work[_VALUE], sky.flux[k, c], count)


@part
def _add_row(total, values, factor, count):
    for index in range(count):
        total[index] += values[index] * factor


@part
def _scatter_row(towards, wrap, scatter_m, depth_in_m, work, out):
    """What arrives inside the skin from a direction."""
    x, y, z = towards[0], towards[1], towards[2]
    nx, ny, nz = work[_NORMAL], work[_NORMAL + 1], work[_NORMAL + 2]
    scale, rate = _1 / (_1 + wrap), _1 / (_16 * scatter_m)
    for index in range(len(depth_in_m)):
        around = max((x * nx[index] + y * ny[index] + z * nz[index] + wrap) * scale, _0)
        out[index] = around * _decayed(depth_in_m[index] * rate)


@part
def _decayed(part):
    """exp(-16 part) = (1 / exp(part))^16, whose series is short: exact to 1e-6 where it is not next to nothing."""
    decay = _1 / (_1 + part * (_1 + part * (_HALF + part * (_SIXTH + part * _24TH))))
    decay *= decay
    decay *= decay
    decay *= decay
    return decay * decay


@part
def _arriving_row(towards, lit, work, out):
    """The share of light from a direction that arrives above the horizon of the relief."""
    x, y, z = towards[0], towards[1], towards[2]
    rx, ry, rz, facing = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2], work[_FACING]
    for index in range(len(lit)):
        cosine = x * rx[index] + y * ry[index] + z * rz[index]
        facing[index] = max(cosine, _LEAST_COSINE)
        out[index] = lit[index] if cosine > _0 else _0


@part
def _lobe_row(towards, f0, squared, count, eye_term, work, out):
    """What a lobe reflects of the light that arrives; as `_glossy`."""
    x, y, z = towards[0], towards[1], towards[2]
    rx, ry, rz = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2]
    vx, vy, vz = work[_VIEW], work[_VIEW + 1], work[_VIEW + 2]
    facing, to_eye, arriving = work[_FACING], work[_TO_EYE], work[_ARRIVING]
    for index in range(count):
        hx, hy, hz = x - vx[index], y - vy[index], z - vz[index]
        inverse = _1 / max(np.sqrt(hx * hx + hy * hy + hz * hz), _TINY)
        to_half = min(max((rx[index] * hx + ry[index] * hy + rz[index] * hz) * inverse, _0), _1)
        away = _1 - min(max((x * hx + y * hy + z * hz) * inverse, _0), _1)
        fresnel = f0 + (_1 - f0) * away * away * away * away * away
        base = to_half * to_half * (squared - _1) + _1
        light = facing[index]
        shadowing = light * eye_term[index] + to_eye[index] * np.sqrt(light * light * (_1 - squared) + squared)
        out[index] = arriving[index] * squared * _HALF * fresnel * light / (base * base * shadowing)


@part
def _store(start, count, sums, vectors, out):
    for index in range(count):
        for c in range(3):
            for axis in range(3):
                out.sky_vectors[start + index, axis, c] = sums[_VECTORS + 3 * axis + c, index]
            for layer in range(2):
                out.scattered[start + index, layer, c] = sums[_SCATTERED + 3 * layer + c, index]
                out.sky_gloss[start + index, layer, c] = sums[_GLOSS + 3 * layer + c, index]
            for lamp in range(out.lamp_vectors.shape[1]):
                out.lamp_vectors[start + index, lamp, c] = vectors[3 * lamp + c, index]


@part
def _add_lamp(lamps, lobes, k, start, count, work, sums, vectors):
    """Add one sample of a lamp to a block."""
    lamp, shadow = lamps.lamp[k], lamps.shadow[k]
    depth, lit = lamps.depth_in_m[k, start : start + count], lamps.lit[k, start : start + count]
    _strength_rows(lamps, k, count, work, work[_ARRIVING])
    for layer in range(2):
        rate = shadow / (_16 * lobes.scatter_m[layer])
        _scatter_lamp_row(lobes.wrap[layer], rate, depth, work, work[_ARRIVING], work[_VALUE])
        for c in range(3):
            _add_row(sums[_SCATTERED + 3 * layer + c], work[_VALUE], lamps.rgb[lamp, c], count)
    x, y, z, strength = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2], work[_ARRIVING]
    rx, ry, rz = work[_RELIEF], work[_RELIEF + 1], work[_RELIEF + 2]
    for index in range(count):
        cosine = x[index] * rx[index] + y[index] * ry[index] + z[index] * rz[index]
        strength[index] *= shadow * lit[index] + _1 - shadow if cosine > _0 else _0
    for axis in range(3):
        _add_product(vectors[3 * lamp + axis], work[_TOWARDS + axis], strength, count)


@part
def _add_product(total, a, b, count):
    for index in range(count):
        total[index] += a[index] * b[index]


@part
def _scatter_lamp_row(wrap, rate, depth_in_m, work, strength, out):
    """What arrives inside the skin from a sample, whose direction is another at every point."""
    x, y, z = work[_TOWARDS], work[_TOWARDS + 1], work[_TOWARDS + 2]
    nx, ny, nz, scale = work[_NORMAL], work[_NORMAL + 1], work[_NORMAL + 2], _1 / (_1 + wrap)
    for index in range(len(depth_in_m)):
        cosine = x[index] * nx[index] + y[index] * ny[index] + z[index] * nz[index]
        out[index] = max((cosine + wrap) * scale, _0) * _decayed(depth_in_m[index] * rate) * strength[index]


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
    """Intensity of a sample, per watt, in a direction with this cosine to its axis."""
    if lamps.is_area[k]:
        facing, tan_spread = max(along, _LEAST_FACING), lamps.tan_spread[k]
        tangent = np.sqrt(max(_1 / (facing * facing) - _1, _0))
        beam = max((tan_spread - tangent) * lamps.spread_share[k], _0) if tan_spread < np.inf else _1
        return max(along, _0) / _PI * beam
    edge = min(max((along - lamps.cos_cone[k]) * lamps.cone_edge[k], _0), _1)
    return (edge * edge * (_3 - _2 * edge) if lamps.cos_cone[k] >= -_1 else _1) / (_4 * _PI)


@part
def _glossy(to_light, x, y, z, normal, view, light_radius_rad, nail, lobes, both):
    """Fill the two lobes for a light in direction (x, y, z), whose cosine to the normal is `to_light` > 0."""
    hx, hy, hz = x - view[0], y - view[1], z - view[2]
    length = max(np.sqrt(hx * hx + hy * hy + hz * hz), _TINY)
    hx, hy, hz = hx / length, hy / length, hz / length
    to_eye = max(-(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]), _GRAZING)
    to_half = min(max(normal[0] * hx + normal[1] * hy + normal[2] * hz, _0), _1)
    away = _1 - min(max(x * hx + y * hy + z * hz, _0), _1)
    fresnel = lobes.f0 + (_1 - lobes.f0) * away * away * away * away * away
    to_light = max(to_light, _LEAST_COSINE)
    for lobe in range(2):
        alpha = lobes.alpha[lobe]
        if lobe == 0:
            alpha += (lobes.nail_alpha - alpha) * nail
        squared = _squared(alpha, light_radius_rad)
        base = to_half * to_half * (squared - _1) + _1
        shadowing = to_light * np.sqrt(to_eye * to_eye * (_1 - squared) + squared) + to_eye * np.sqrt(
            to_light * to_light * (_1 - squared) + squared
        )
        both[lobe] = squared / (base * base) * _HALF / shadowing * fresnel * to_light


@compiled
def enlarge_pixels(maps, detail, pixels, world2cam, width, smooth, min_alpha, first, last, out):
    """Fill `out` (`EnlargedArrays`) for pixels [first, last) of the full-size image.

    `maps` [h * w, C] begins with premultiplied coefficients and ends with normals in camera axes and alpha; `detail`
    [H * W, 12] is what is added at full size.
    """
    here, at, weights = np.empty(maps.shape[1], np.float32), np.empty(4, np.int64), np.empty(4, np.float32)
    for index in range(first, last):
        _neighbours(len(maps), width, pixels[index], at, weights)
        _blend(maps, at, weights, here)
        _enlarge_pixel(index, pixels[index], here, detail, world2cam, smooth, min_alpha, out)


@part
def _enlarge_pixel(index, pixel, here, detail, world2cam, smooth, min_alpha, out):
    count, end = out.coefficients.shape[1], len(here)
    straight = _1 / max(here[end - 1], min_alpha)
    alpha = here[end - 1] + detail[pixel, count - smooth + 3]
    out.alpha[pixel] = alpha
    visible = min(max(alpha, _0), _1)
    for k in range(count):
        value = here[k] * straight
        if k >= smooth:
            value += detail[pixel, k - smooth]
        out.coefficients[index, k] = max(value, _0) * visible
    x = here[end - 4] * straight + detail[pixel, count - smooth]
    y = here[end - 3] * straight + detail[pixel, count - smooth + 1]
    z = here[end - 2] * straight + detail[pixel, count - smooth + 2]
    length = max(np.sqrt(x * x + y * y + z * z), _TINY)
    for k in range(3):
        out.normal[index, k] = (world2cam[0, k] * x + world2cam[1, k] * y + world2cam[2, k] * z) / length


@compiled
def smooth_pixels(pixels, row, width, min_alpha, before, first, last, after):
    """Fill `after` for pixels [first, last): means of `before` (`EnlargedArrays`) over 3 x 3 pixels of the hand.

    `row` [H * W] tells where a pixel stands among `pixels`, -1 for none.
    """
    height, count = len(row) // width, before.coefficients.shape[1]
    for index in range(first, last):
        y, x = pixels[index] // width, pixels[index] % width
        coefficients, normal, total = after.coefficients[index], after.normal[index], _0
        coefficients[:] = _0
        normal[:] = _0
        for dy in range(max(-y, -1), min(height - y, 2)):
            for dx in range(max(-x, -1), min(width - x, 2)):
                there = pixels[index] + dy * width + dx
                other = row[there]
                if other < 0:
                    continue
                share = (_HALF if dy == 0 else _QUARTER) * (_HALF if dx == 0 else _QUARTER)
                weight = share * min(max(before.alpha[there], min_alpha), _1)
                total += weight
                for k in range(count):
                    coefficients[k] += share * before.coefficients[other, k]
                for k in range(3):
                    normal[k] += weight * before.normal[other, k]
        scale = min(max(before.alpha[pixels[index]], min_alpha), _1) / total
        for k in range(count):
            coefficients[k] *= scale
        length = max(np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]), _TINY)
        for k in range(3):
            normal[k] /= length


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


@compiled
def relit_pixels(image, lobes, first, last, out):
    """Fill out [H * W, 3] with the colours of pixels [first, last) of `image` (`RelitImage`)."""
    lamps, columns = len(image.lamp_rgb), image.maps.shape[1]
    here, both, rgb = np.empty(columns, np.float32), np.empty(2, np.float32), np.empty(3, np.float32)
    at, around = np.empty(4, np.int64), np.empty(4, np.float32)
    sky_at, gloss_at, scattered_at, arriving_at = 3 * lamps, 9 + 3 * lamps, 15 + 3 * lamps, 21 + 3 * lamps
    for index in range(first, last):
        _neighbours(len(image.maps), image.width, image.pixel[index], at, around)
        _blend(image.maps, at, image.share[index], here)
        normal, view, weights = image.normal[index], image.view_direction[index], image.coefficients[index]
        for c in range(3):
            of_sky = normal[0] * here[sky_at + c] + normal[1] * here[sky_at + 3 + c] + normal[2] * here[sky_at + 6 + c]
            rgb[c] = (
                weights[DIFFUSE + c] * max(of_sky, _0)
                + weights[SCATTERED + c] * here[scattered_at + c]
                + weights[SCATTERED + 3 + c] * here[scattered_at + 3 + c]
                + weights[GLOSS] * here[gloss_at + c]
                + weights[GLOSS + 1] * here[gloss_at + 3 + c]
            )
        for lamp in range(lamps):
            x, y, z = here[3 * lamp], here[3 * lamp + 1], here[3 * lamp + 2]
            facing = x * normal[0] + y * normal[1] + z * normal[2]
            if facing <= _0:
                continue
            strength = max(np.sqrt(x * x + y * y + z * z), _TINY)
            x, y, z = x / strength, y / strength, z / strength
            radius_rad, nail = image.lamp_radius_rad[lamp], image.nail[index]
            _glossy(facing / strength, x, y, z, normal, view, radius_rad, nail, lobes, both)
            gloss = strength * (weights[GLOSS] * both[0] + weights[GLOSS + 1] * both[1])
            for c in range(3):
                rgb[c] += image.lamp_rgb[lamp, c] * (weights[DIFFUSE + c] * facing + gloss)
        for c in range(3):
            white = weights[DIFFUSE + c] + weights[SCATTERED + c] + weights[SCATTERED + 3 + c]
            out[image.pixel[index], c] = rgb[c] * here[arriving_at + c] + white * here[arriving_at + 3 + c]


@compiled
def ray_shares(pixel, width, depth_of_rays, skin_depth, edge_m, first, last, shares):
    """Fill shares [P, 4] of pixels [first, last) as `nerf.relighting.shares_of_rays`.

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
        _neighbours(len(depth_of_rays), width, here, at, share)
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


@compiled
def step_normals(at, share, row, width, of_rays, normal, first, last, out):
    """Fill out [P, 3] for pixels [first, last) as `nerf.relighting.normals_at_steps`.

    `row` [h * w] tells which of the normals `of_rays` [R, 3] a low-resolution pixel has, -1 for none.
    """
    around, even, mean = np.empty(4, np.int64), np.empty(4, np.float32), np.empty(3, np.float32)
    for index in range(first, last):
        _neighbours(len(row), width, at[index], around, even)
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
        length = max(np.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]), _TINY)
        for x in range(3):
            out[index, x] = (_1 - off) * normal[index, x] + off * mean[x] / length
            squared += out[index, x] * out[index, x]
        length = max(np.sqrt(squared), _TINY)
        for x in range(3):
            out[index, x] /= length


@part
def _guided(share, depths, depth, edge_m, out):
    """The shares of the rays at a depth, or of all if none is there."""
    total, plain = _0, _0
    for k in range(4):
        gap = (depth - depths[k]) / edge_m
        out[k] = share[k] * np.exp(-gap * gap) if share[k] > _0 and depth < np.inf else _0
        total += out[k]
        plain += share[k]
    for k in range(4):
        out[k] = out[k] / total if total > LEAST_SHARE else share[k] / plain


@part
def _neighbours(count, width, pixel, at, weights):
    """Fill the four low-resolution pixels around a full-size one, and their bilinear weights."""
    height = count // width
    row, column = pixel // (2 * width), pixel % (2 * width)
    top = min(max((row - 1) // 2, 0), height - 1)
    left = min(max((column - 1) // 2, 0), width - 1)
    bottom, right = min((row + 1) // 2, height - 1), min((column + 1) // 2, width - 1)
    wy = _QUARTER if row % 2 else _3Q
    wx = _QUARTER if column % 2 else _3Q
    at[0], at[1], at[2], at[3] = top * width + left, top * width + right, bottom * width + left, bottom * width + right
    weights[0], weights[1] = (_1 - wy) * (_1 - wx), (_1 - wy) * wx
    weights[2], weights[3] = wy * (_1 - wx), wy * wx


@part
def _blend(maps, at, weights, here):
    a, b, c, d = np.uintp(at[0]), np.uintp(at[1]), np.uintp(at[2]), np.uintp(at[3])
    wa, wb, wc, wd = weights[0], weights[1], weights[2], weights[3]
    for k in range(np.uintp(len(here))):
        here[k] = wa * maps[a, k] + wb * maps[b, k] + wc * maps[c, k] + wd * maps[d, k]
