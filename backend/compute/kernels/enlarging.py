"""Equals `image.relighting.smooth_enlarged_rays`: rays at full size with their detail, and means over 3 x 3 pixels.

Row by row: a row's pixels stand side by side in a buffer, and the means of three of them are one long sum.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .gloss import TINY

_0, _QUARTER, _HALF, _3Q, _1 = (np.float32(value) for value in (0, 0.25, 0.5, 0.75, 1))
_COEFFICIENTS, _SMOOTH, _NORMAL, _WEIGHT, _VALUES = 14, 6, 14, 17, 18
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
    above, left_out = _1 - below, np.uintp(maps.shape[1] - _VALUES)
    for x in range(width):
        a, b = np.uintp(top + x), np.uintp(bottom + x)
        for k in range(_VALUES):
            to = np.uintp(k)
            at = to if k < _COEFFICIENTS else to + left_out
            line[np.uintp(x), to] = above * maps[a, at] + below * maps[b, at]


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
    for k in range(_WEIGHT):
        row[to + np.uintp(k)] = of_left * line[left, np.uintp(k)] + of_right * line[right, np.uintp(k)]
    for k in range(_SMOOTH, _WEIGHT):
        row[to + np.uintp(k)] += detail[pixel, np.uintp(k - _SMOOTH)]
    for k in range(_COEFFICIENTS):
        row[to + np.uintp(k)] = max(row[to + np.uintp(k)], _0) * visible
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
    for k in range(_COEFFICIENTS):
        at, to = left + np.uintp(k), np.uintp(k)
        out.coefficients[index, to] = (
            beside * (summed[at] + summed[at + _STEP + _STEP]) + (beside + beside) * summed[at + _STEP]
        )
    squared = _0
    for k in range(3):
        at, to = left + np.uintp(_NORMAL + k), np.uintp(k)
        value = _HALF * (summed[at] + summed[at + _STEP + _STEP]) + summed[at + _STEP]
        out.normal[index, to] = value
        squared += value * value
    inverse = _1 / max(np.sqrt(squared), TINY)
    for k in range(3):
        out.normal[index, np.uintp(k)] *= inverse
