"""The full-size image of a relightable hand: as `image.shading`, and `field.rays.view_directions`.

Rays are enlarged row by row: a row's pixels stand side by side in a buffer, and the means of three of them are one long
sum.
"""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from .brdf import (
    TINY,
    bump_shadowing,
    clamped_reflection_normal,
    ggx,
    glossy_normal,
    horizon_occlusion,
    mirror,
    of_even_light,
    on_nail,
    row_of_lobe,
    share_above,
)
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part

_0, _QUARTER, _HALF, _3Q, _1, _2 = (np.float32(value) for value in (0, 0.25, 0.5, 0.75, 1, 2))
SCATTERED, DIFFUSE, GLOSS = 3, 9, 12
"""Where these begin among the coefficients."""
SHALLOW_SCALE = np.float32(1.25)
"""The second `SCATTERED_SCALE` of `light.lighting`."""


class RelitImage(NamedTuple):
    """P pixels of a full-size image and the light's features at its R low-resolution rays.

    Attributes:
        pixel: [P] row * width + column, in the full-size image.
        coefficients: [P, 14].
        normal: [P, 3].
        surface_normal: [P, 3].
        blurred_normal: [P, 3].
        alpha_squared: [P].
        view_direction: [P, 3].
        share: [P, 4] of the four low-resolution pixels around each.
        light: [R, C] features: lamp vectors, sky vectors, the sky's seen shares, near-field specular light, scattered
            light, `arriving` and `reflected`.
        row: [h * w] which ray a low-resolution pixel has, -1 for none.
        width: of the low-resolution image.
        lamp_rgb: [L, 3].
        lamp_radius_rad: [L].
        nail: [P].
        sharpness: [3].
    """

    pixel: np.ndarray
    coefficients: np.ndarray
    normal: np.ndarray
    surface_normal: np.ndarray
    blurred_normal: np.ndarray
    alpha_squared: np.ndarray
    view_direction: np.ndarray
    share: np.ndarray
    light: np.ndarray
    row: np.ndarray
    width: int
    lamp_rgb: np.ndarray
    lamp_radius_rad: np.ndarray
    nail: np.ndarray
    sharpness: np.ndarray


EnlargedArrays = namedtuple("EnlargedArrays", "coefficients normal alpha")
"""As `image.shading.EnlargedRays`."""


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


class _PixelBuffers(NamedTuple):
    """What a pixel is lit in.

    Attributes:
        here: [C] light of the rays around.
        rgb: [3].
        relief: [3] what the relief adds.
        mirrored: [2, 3] the sky in both lobes.
        even: [2] of light of 1 from everywhere.
        squared: [2] alphas.
        mirroring: [3] normal that mirrors the sky.
        steep: [3] normal of gloss.
        steeper: [3] that, if it mirrors the skin.
        values: [8] of a texel.
    """

    here: np.ndarray
    rgb: np.ndarray
    relief: np.ndarray
    mirrored: np.ndarray
    even: np.ndarray
    squared: np.ndarray
    mirroring: np.ndarray
    steep: np.ndarray
    steeper: np.ndarray
    values: np.ndarray


@compiled
def relit_pixels(image, sky, lobes, first, last, out):
    """Fill out [H * W, 3] with the colours of pixels [first, last) of `image` (`RelitImage`); `sky`: `MirrorArrays`."""
    buffers = _PixelBuffers(
        np.empty(image.light.shape[1], np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty((2, 3), np.float32),
        np.empty(2, np.float32),
        np.empty(2, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(8, np.float32),
    )
    for index in range(first, last):
        _relight(image, sky, lobes, np.uintp(index), buffers, out)


@part
def _relight(image, sky, lobes, index, buffers, out):
    """Fill the colour of a pixel."""
    lamps = len(image.lamp_rgb)
    sky_at, visible_at, near_at = 3 * lamps, 3 * lamps + 9, 3 * lamps + 11
    scattered_at, arriving_at = 3 * lamps + 17, 3 * lamps + 23
    here, rgb, relief, mirrored, even, squared, mirroring, steep, steeper, values = buffers
    weights = image.coefficients[index]
    if not weights.any():
        return  # beside the surface
    _blend(image, index, len(image.row) // image.width, here)
    normal, view = image.normal[index], image.view_direction[index]
    surface_normal, blurred, nail = image.surface_normal[index], image.blurred_normal[index], image.nail[index]
    along, along_blurred = _dot(normal, surface_normal), _dot(blurred, surface_normal)
    clamped_reflection_normal(normal, surface_normal, view, along, mirroring)
    squared[0], squared[1] = on_nail(nail, lobes), image.alpha_squared[index]
    skin = row_of_lobe(sky, squared[1])
    for lobe in range(2):
        even[lobe], mirrored[lobe, 0], mirrored[lobe, 1], mirrored[lobe, 2] = _0, _0, _0, _0
        # An avatar's surface has the second lobe alone on skin, and the first on nails.
        if weights[GLOSS + lobe] > _0 or (nail > _0 if lobe == 0 else nail < _1):
            rough = skin if lobe == 1 else row_of_lobe(sky, squared[0])
            even[lobe] = mirror(sky, mirroring, view, rough, values, mirrored[lobe])
    # The first lobe on nails, the second on skin: what is reflected does not enter.
    of_lobes = even[1] + nail * (even[0] - even[1])
    of_surface = of_even_light(sky, -_dot(surface_normal, view), skin)
    if nail > _0:
        of_nail = of_even_light(sky, -_dot(surface_normal, view), row_of_lobe(sky, squared[0]))
        of_surface += nail * (of_nail - of_surface)
    under = (_1 - of_lobes) / (_1 - of_surface)
    to_eye = -_dot(mirroring, view)
    above = _dot(surface_normal, view) + _2 * to_eye * _dot(mirroring, surface_normal)
    for lobe in range(2):
        leaving = horizon_occlusion(above, to_eye, squared[lobe])
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
            + weights[GLOSS] * (here[visible_at] * mirrored[0, c] + here[near_at + c])
            + weights[GLOSS + 1] * (here[visible_at + 1] * mirrored[1, c] + here[near_at + 3 + c])
        )
    relief[:] = _0
    if lamps > 0:
        along_steep = glossy_normal(normal, surface_normal, along, steep)
        clamped_reflection_normal(steep, surface_normal, view, along_steep, steeper)
    for lamp in range(lamps):
        x, y, z = here[3 * lamp], here[3 * lamp + 1], here[3 * lamp + 2]
        strength = max(np.sqrt(x * x + y * y + z * z), TINY)
        x, y, z = x / strength, y / strength, z / strength
        sharp = _bumped(normal, x, y, z, along, surface_normal)
        wide = _bumped(blurred, x, y, z, along_blurred, surface_normal)
        rising = x * surface_normal[0] + y * surface_normal[1] + z * surface_normal[2]
        flat, above, specular = max(rising, _0), share_above(rising, image.lamp_radius_rad[lamp]), _0
        if above > _0:
            facing_mirror = x * steeper[0] + y * steeper[1] + z * steeper[2]
            of_lamp = facing_mirror, x, y, z, steeper, view, image.lamp_radius_rad[lamp]
            specular = strength * above * ggx(*of_lamp, squared, lobes, weights[GLOSS], weights[GLOSS + 1])
        for c in range(3):
            bent = wide + image.sharpness[c] * (sharp - wide)
            rgb[c] += image.lamp_rgb[lamp, c] * (strength * weights[DIFFUSE + c] * bent * under + specular)
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
    """Compute what a diffuse surface reflects of a light in direction (x, y, z)."""
    facing = x * normal[0] + y * normal[1] + z * normal[2]
    return facing * bump_shadowing(facing, x, y, z, along, surface_normal) if facing > _0 else _0


@part
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def neighbours(height, width, pixel):
    """Find the four low-resolution pixels around one at twice the size, and their bilinear weights, as tuples."""
    large, at = np.uint32(2 * width), np.uint32(pixel)
    row = np.uint32(at // large)
    y, x = np.int64(row), np.int64(at) - np.int64(row) * np.int64(large)
    top, left = max((y - 1) >> 1, 0) * width, max((x - 1) >> 1, 0)
    bottom, right = min((y + 1) >> 1, height - 1) * width, min((x + 1) >> 1, width - 1)
    below, beside = _QUARTER if y & 1 else _3Q, _QUARTER if x & 1 else _3Q
    above, here = _1 - below, _1 - beside
    pixels = np.uintp(top + left), np.uintp(top + right), np.uintp(bottom + left), np.uintp(bottom + right)
    return pixels, (above * here, above * beside, below * here, below * beside)


@part
def _blend(image, index, height, here):
    """Fill the light [C] that arrives at a pixel, of the rays around it."""
    (a, b, c, d), _ = neighbours(height, image.width, image.pixel[index])
    ra, rb, rc, rd = image.row[a], image.row[b], image.row[c], image.row[d]
    wa, wb = image.share[index, 0] if ra >= 0 else _0, image.share[index, 1] if rb >= 0 else _0
    wc, wd = image.share[index, 2] if rc >= 0 else _0, image.share[index, 3] if rd >= 0 else _0
    a, b, c, d = np.uintp(max(ra, 0)), np.uintp(max(rb, 0)), np.uintp(max(rc, 0)), np.uintp(max(rd, 0))
    rows = image.light
    for k in range(np.uintp(len(here))):
        here[k] = wa * rows[a, k] + wb * rows[b, k] + wc * rows[c, k] + wd * rows[d, k]


_SMOOTH, _NORMAL, _WEIGHT, _VALUES = 6, 14, 17, 18
"""A pixel's values: coefficients, the first of them without detail, normal, and alpha or what is made of it."""
_ALPHA = _VALUES - 1 - _SMOOTH  # among the detail's channels
_STEP, _NEXT = np.uintp(_VALUES), np.uintp(1)


@compiled
def enlarge_rows(maps, detail, pixels, starts, world2cam, width, min_alpha, first, last, out):
    """Fill `out` (`EnlargedArrays`) for the pixels in rows [first, last) of the full-size image.

    Args:
        maps: [h * w, C] begin with premultiplied coefficients and end with normals in camera axes and alpha.
        detail: [H * W, 12] is added at full size.
        pixels: [P] of the hand, in order.
        starts: [H + 1] where each row's pixels begin among these.
        world2cam: [4, 4].
        width: of the maps, px.
        min_alpha: by which values are divided at least.
        first: row.
        last: row.
        out: for P pixels.
    """
    height, columns = 2 * (len(maps) // width), 2 * width
    line, rows = np.empty((width, _VALUES), np.float32), np.zeros((3, (columns + 2) * _VALUES), np.float32)
    summed = np.empty((columns + 2) * _VALUES, np.float32)  # a pixel's border on either side
    for y in range(first - 1, last + 1):
        row = rows[y % 3]
        row[:] = _0
        if 0 <= y < height and starts[y] < starts[y + 1]:
            _blend_line(maps, y, width, line)
            for index in range(starts[y], starts[y + 1]):
                pixel = np.uintp(pixels[index])
                _enlarge_pixel(pixel, pixels[index] - y * columns, line, detail, world2cam, min_alpha, row, out.alpha)
        if y > first:
            _sum_rows(rows[(y - 2) % 3], rows[(y - 1) % 3], row, summed)
            for index in range(starts[y - 1], starts[y]):
                column = np.uintp(pixels[index] - (y - 1) * columns)
                _mean_of_pixel(np.uintp(index), np.uintp(pixels[index]), column, min_alpha, summed, out)


@part
def _blend_line(maps, y, width, line):
    """Fill line [w, 18] with the maps' values between the two of their rows that lie about a full-size row."""
    top, bottom = max((y - 1) // 2, 0) * width, min((y + 1) // 2, len(maps) // width - 1) * width
    below = _QUARTER if y % 2 else _3Q
    # Numbers that are not known to the compiler, or these were no vector loops.
    values = np.uintp(line.shape[1])
    above, left_out, coefficients = _1 - below, np.uintp(maps.shape[1]) - values, values - np.uintp(4)
    for x in range(width):
        a, b = np.uintp(top + x), np.uintp(bottom + x)
        to = np.uintp(x)
        for k in range(coefficients):
            line[to, k] = above * maps[a, k] + below * maps[b, k]
        for k in range(coefficients, values):
            line[to, k] = above * maps[a, k + left_out] + below * maps[b, k + left_out]


@part
def _enlarge_pixel(pixel, x, line, detail, world2cam, min_alpha, row, alphas):
    """Fill the values of the pixel in column x of a row: premultiplied, the last of them alpha's share of the means."""
    left, right = np.uintp(max((x - 1) // 2, 0)), np.uintp(min((x + 1) // 2, len(line) - 1))
    of_right = _QUARTER if x % 2 else _3Q
    of_left, to = _1 - of_right, np.uintp(x + 1) * _STEP
    enlarged = of_left * line[left, _WEIGHT] + of_right * line[right, _WEIGHT]
    alpha, straight = enlarged + detail[pixel, _ALPHA], _1 / max(enlarged, min_alpha)
    alphas[pixel] = alpha
    visible, weight = min(max(alpha, _0), _1), min(max(alpha, min_alpha), _1)
    of_left, of_right = of_left * straight, of_right * straight
    values = np.uintp(line.shape[1] - 1)  # not known to the compiler, or these were no vector loops
    for k in range(values):
        row[to + k] = of_left * line[left, k] + of_right * line[right, k]
    smooth = np.uintp(_SMOOTH)
    for k in range(smooth, values):
        row[to + k] += detail[pixel, k - smooth]
    for k in range(values - np.uintp(3)):
        row[to + k] = max(row[to + k], _0) * visible
    at = to + np.uintp(_NORMAL)
    nx, ny, nz = row[at], row[at + _NEXT], row[at + _NEXT + _NEXT]
    scale = weight / max(np.sqrt(nx * nx + ny * ny + nz * nz), TINY)
    for k in range(3):
        row[at + np.uintp(k)] = (world2cam[0, k] * nx + world2cam[1, k] * ny + world2cam[2, k] * nz) * scale
    row[to + np.uintp(_WEIGHT)] = weight


@part
def _sum_rows(above, here, below, out):
    for at in range(np.uintp(len(out))):
        out[at] = _QUARTER * above[at] + _HALF * here[at] + _QUARTER * below[at]


@part
def _mean_of_pixel(index, pixel, column, min_alpha, summed, out):
    """Fill the means of a pixel of the row whose neighbours' sums are given."""
    left = column * _STEP
    right, at = left + _STEP + _STEP, np.uintp(_WEIGHT)
    total = _QUARTER * (summed[left + at] + summed[right + at]) + _HALF * summed[left + _STEP + at]
    beside = _QUARTER * min(max(out.alpha[pixel], min_alpha), _1) / total
    middle = left + _STEP
    for k in range(np.uintp(out.coefficients.shape[1])):
        at_sides = summed[left + k] + summed[right + k]
        out.coefficients[index, k] = beside * at_sides + (beside + beside) * summed[middle + k]
    squared = _0
    for k in range(3):
        at, to = left + np.uintp(_NORMAL + k), np.uintp(k)
        value = _HALF * (summed[at] + summed[at + _STEP + _STEP]) + summed[at + _STEP]
        out.normal[index, to] = value
        squared += value * value
    inverse = _1 / max(np.sqrt(squared), TINY)
    for k in range(3):
        out.normal[index, np.uintp(k)] *= inverse
