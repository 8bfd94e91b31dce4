"""Equals `shares_of_rays`, `normals_at_steps` and `relit` of `image.relighting`, and `field.rays.view_directions`."""

from __future__ import annotations

import numpy as np

from .bump import bump_shadowing, leaving_share, mirroring_normal
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .gloss import TINY, glossy, on_nail
from .mirrored_sky import mirror, of_even_light

_0, _QUARTER, _HALF, _3Q, _1, _2 = (np.float32(value) for value in (0, 0.25, 0.5, 0.75, 1, 2))
LEAST_SHARE, OF_PIXEL, OF_NEXT = (np.float32(value) for value in (0.01, 0.5, 0.125))
"""As in `image.relighting`."""
SCATTERED, DIFFUSE, GLOSS = 3, 9, 12
"""Where these begin among the coefficients."""
SHALLOW_SCALE = np.float32(1.25)
"""The second `SCATTERED_SCALE` of `light.lighting`."""


@compiled
def view_directions(pixel, width, axes, first, last, out):
    """Fill out [P, 3] with the unit directions of pixels [first, last) as `field.rays.view_directions`.

    A pixel's direction is (x, y, 1) times `axes` [3, 3].
    """
    for index in range(first, last):
        x, y = np.float32(pixel[index] % width) + _HALF, np.float32(pixel[index] // width) + _HALF
        dx = x * axes[0, 0] + y * axes[1, 0] + axes[2, 0]
        dy = x * axes[0, 1] + y * axes[1, 1] + axes[2, 1]
        dz = x * axes[0, 2] + y * axes[1, 2] + axes[2, 2]
        inverse = _1 / np.sqrt(dx * dx + dy * dy + dz * dz)
        out[index, 0], out[index, 1], out[index, 2] = dx * inverse, dy * inverse, dz * inverse


@compiled
def relit_pixels(image, sky, lobes, first, last, out):
    """Fill out [H * W, 3] with the colours of pixels [first, last) of `image` (`RelitImage`); `sky`: `MirrorArrays`."""
    lamps, columns = len(image.lamp_rgb), image.light.shape[1]
    here, both, rgb = np.empty(columns, np.float32), np.empty(2, np.float32), np.empty(3, np.float32)
    at, around = np.empty(4, np.int64), np.empty(4, np.float32)
    sky_at, seen_at, near_at = 3 * lamps, 3 * lamps + 9, 3 * lamps + 11
    scattered_at, arriving_at = 3 * lamps + 17, 3 * lamps + 23
    mirrored, mirroring = np.empty((2, 3), np.float32), np.empty(3, np.float32)
    even, squared, relief = np.empty(2, np.float32), np.empty(2, np.float32), np.empty(3, np.float32)
    for index in range(first, last):
        _neighbours(len(image.row), image.width, image.pixel[index], at, around)
        for k in range(4):
            ray = image.row[at[k]]
            at[k], around[k] = max(ray, 0), image.share[index, k] if ray >= 0 else _0
        _blend(image.light, at, around, here)
        normal, view, weights = image.normal[index], image.view_direction[index], image.coefficients[index]
        surface_normal, blurred, nail = image.surface_normal[index], image.blurred_normal[index], image.nail[index]
        along, along_blurred = _dot(normal, surface_normal), _dot(blurred, surface_normal)
        mirroring_normal(normal, surface_normal, view, along, mirroring)
        squared[0], squared[1] = on_nail(nail, lobes), image.alpha_squared[index]
        for lobe in range(2):
            even[lobe], mirrored[lobe, 0], mirrored[lobe, 1], mirrored[lobe, 2] = _0, _0, _0, _0
            # Known skin has the second lobe alone, and its nails the first.
            if weights[GLOSS + lobe] > _0 or (nail > _0 if lobe == 0 else nail < _1):
                even[lobe] = mirror(sky, mirroring, view, squared[lobe], mirrored[lobe])
        # The first lobe on nails, the second on skin: what gloss reflects does not enter.
        of_lobes = even[1] + nail * (even[0] - even[1])
        of_surface = of_even_light(sky, -_dot(surface_normal, view), squared[1])
        if nail > _0:
            of_nail = of_even_light(sky, -_dot(surface_normal, view), squared[0])
            of_surface += nail * (of_nail - of_surface)
        under = (_1 - of_lobes) / (_1 - of_surface)
        to_eye = -_dot(mirroring, view)
        above = _dot(surface_normal, view) + _2 * to_eye * _dot(mirroring, surface_normal)
        for lobe in range(2):
            leaving = leaving_share(above, to_eye, squared[lobe])
            even[lobe] *= leaving
            for c in range(3):
                mirrored[lobe, c] *= leaving
        for c in range(3):
            x, y, z = here[sky_at + c], here[sky_at + 3 + c], here[sky_at + 6 + c]
            sharp = max(x * normal[0] + y * normal[1] + z * normal[2], _0)
            wide = max(x * blurred[0] + y * blurred[1] + z * blurred[2], _0)
            rgb[c] = (
                weights[DIFFUSE + c] * (wide + image.sharpness[c] * (sharp - wide)) * under
                + weights[SCATTERED + c] * here[scattered_at + c] * under
                + weights[GLOSS] * (here[seen_at] * mirrored[0, c] + here[near_at + c])
                + weights[GLOSS + 1] * (here[seen_at + 1] * mirrored[1, c] + here[near_at + 3 + c])
            )
        relief[:] = _0
        for lamp in range(lamps):
            x, y, z = here[3 * lamp], here[3 * lamp + 1], here[3 * lamp + 2]
            strength = max(np.sqrt(x * x + y * y + z * z), TINY)
            x, y, z = x / strength, y / strength, z / strength
            sharp = _bumped(normal, x, y, z, along, surface_normal)
            wide = _bumped(blurred, x, y, z, along_blurred, surface_normal)
            flat = max(x * surface_normal[0] + y * surface_normal[1] + z * surface_normal[2], _0)
            facing_mirror = x * mirroring[0] + y * mirroring[1] + z * mirroring[2]
            gloss = _0
            if facing_mirror > _0:
                radius_rad = image.lamp_radius_rad[lamp]
                glossy(facing_mirror, x, y, z, mirroring, view, radius_rad, squared, lobes.squared_index, both)
                gloss = strength * (weights[GLOSS] * both[0] + weights[GLOSS + 1] * both[1])
            for c in range(3):
                bent = wide + image.sharpness[c] * (sharp - wide)
                rgb[c] += image.lamp_rgb[lamp, c] * (strength * weights[DIFFUSE + c] * bent * under + gloss)
                relief[c] += image.lamp_rgb[lamp, c] * strength * (bent - flat)
        of_skin = weights[GLOSS] * even[0] + weights[GLOSS + 1] * even[1]
        for c in range(3):
            # Light that enters a little deeper shows the relief, too.
            shallow = max(here[scattered_at + 3 + c] + SHALLOW_SCALE * relief[c], _0)
            rgb[c] += weights[SCATTERED + 3 + c] * shallow * under
            share = weights[DIFFUSE + c] + weights[SCATTERED + c] + weights[SCATTERED + 3 + c] + of_skin
            out[image.pixel[index], c] = rgb[c] * here[arriving_at + c] + share * here[arriving_at + 3 + c]


@part
def _bumped(normal, x, y, z, along, surface_normal):
    """What a diffuse surface reflects of a light in direction (x, y, z)."""
    facing = x * normal[0] + y * normal[1] + z * normal[2]
    return facing * bump_shadowing(facing, x, y, z, along, surface_normal) if facing > _0 else _0


@part
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def ray_shares(pixel, width, depth_of_rays, skin_depth, edge_m, first, last, shares):
    """Fill shares [P, 4] of pixels [first, last) as `image.relighting.shares_of_rays`.

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
    """Fill out [P, 3] for pixels [first, last) as `image.relighting.normals_at_steps`.

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
        length = max(np.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]), TINY)
        for x in range(3):
            out[index, x] = (_1 - off) * normal[index, x] + off * mean[x] / length
            squared += out[index, x] * out[index, x]
        length = max(np.sqrt(squared), TINY)
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
def _blend(rows, at, weights, here):
    a, b, c, d = np.uintp(at[0]), np.uintp(at[1]), np.uintp(at[2]), np.uintp(at[3])
    wa, wb, wc, wd = weights[0], weights[1], weights[2], weights[3]
    for k in range(np.uintp(len(here))):
        here[k] = wa * rows[a, k] + wb * rows[b, k] + wc * rows[c, k] + wd * rows[d, k]
