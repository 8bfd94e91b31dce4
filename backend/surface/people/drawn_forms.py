"""What rises on an invented person's hand: veins, and flesh in the hollows between the metacarpals.

A ball that rolls over the back across the hand dips so far between two metacarpals; flesh fills a share of what it
leaves free, more of some people than of others.
"""

from __future__ import annotations

import numpy as np

from .hand_chart import HandChart, smoothstep
from .look import PersonLook
from .skin_lines import PlaneImage, plane

_START_MM, _END_MM, _TEXEL_MM = (0.0, -44.0), (96.0, 44.0), 1.0
_BALL_MM, _REACH_MM = 250.0, 14
_SPREAD_MM = 1.6  # deviation of the weights of vertices around a texel, and of what smooths the padding
_ON_BACK = 0.3, 0.6  # of the normal's dorsal part
_MOST_MM, _LEAST_COUNT = 3.0, 1e-4
# Where along the hand and how far across it the outermost metacarpals lie, and how wide each is.
_LITTLE_RAY_MM, _INDEX_RAY_MM, _AT_RAY_MM = ((25.0, 77.0), (-17.0, -31.0)), ((27.0, 92.0), (12.0, 25.5)), 5.0


def drawn_veins(chart: HandChart, lines: PlaneImage) -> np.ndarray:
    """Return where veins rise [N], 1 at the highest: on the back of hand and arm, and less on the arm's inside."""
    up = smoothstep(chart.normals[:, 1], 0.1, 0.5) * (1 - chart.on_digit)
    inner = 0.5 * smoothstep(-chart.normals[:, 1], 0.2, 0.7) * chart.arm
    return lines.at(chart.points_mm) * np.maximum(up, inner)


def drawn_padding_mm(chart: HandChart, look: PersonLook) -> np.ndarray:
    """Compute how high [N] flesh rises along the normals of a chart's vertices, mm.

    Args:
        chart: at the vertices of the surface.
        look: of the person; age and build say which share of the hollows is filled.
    """
    up = smoothstep(chart.normals[:, 1], *_ON_BACK) * (1 - chart.on_digit)
    heights = _height_image(chart, up > 0)
    hollow = _smoothed(_closed_across(heights) - heights)
    d, r = plane(chart.points_mm).T
    little, index = (np.interp(d, *ray) for ray in (_LITTLE_RAY_MM, _INDEX_RAY_MM))
    between = smoothstep(r - little, 0.0, _AT_RAY_MM) * smoothstep(index - r, 0.0, _AT_RAY_MM)
    ends = smoothstep(d, 8.0, 28.0) * smoothstep(d, 92.0, 76.0) * between
    free_mm = PlaneImage(hollow, _START_MM, _TEXEL_MM).at(chart.points_mm)
    return np.minimum(look.padding * free_mm * up * ends, _MOST_MM)


def _height_image(chart: HandChart, on_back: np.ndarray) -> np.ndarray:
    """Return the heights [H, W] of the back over the plane, mm, as means of the vertices around.

    Where there are none it is as low as the lowest.
    """
    shape = tuple(round((end - start) / _TEXEL_MM) for start, end in zip(_START_MM, _END_MM, strict=True))
    texel = np.round((plane(chart.points_mm) - np.array(_START_MM, np.float32)) / _TEXEL_MM).astype(int)
    taken = on_back & (texel >= 0).all(1) & (texel < shape).all(1)
    at, height = tuple(texel[taken].T), chart.points_mm[taken, 1]
    sums, count = np.zeros(shape), np.zeros(shape)
    np.add.at(sums, at, height)
    np.add.at(count, at, 1)
    count = _smoothed(count)
    return np.where(count > _LEAST_COUNT, _smoothed(sums) / count.clip(_LEAST_COUNT), height.min())


def _closed_across(heights: np.ndarray) -> np.ndarray:
    """Return the heights of what a ball that rolls across the hand does not reach."""
    offset = np.arange(-_REACH_MM, _REACH_MM + 1)
    drop = (offset * _TEXEL_MM) ** 2 / (2 * _BALL_MM)

    def extreme(values: np.ndarray, way: int) -> np.ndarray:
        padded = np.pad(values, ((0, 0), (_REACH_MM, _REACH_MM)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, len(offset), 1)
        return (windows - drop).max(-1) if way > 0 else (windows + drop).min(-1)

    return extreme(extreme(heights, 1), -1)


def _smoothed(image: np.ndarray) -> np.ndarray:
    offset = np.arange(-6, 7)
    weight = np.exp(-0.5 * (offset * _TEXEL_MM / _SPREAD_MM) ** 2)
    weight /= weight.sum()
    for axis in (0, 1):
        image = np.apply_along_axis(np.convolve, axis, image, weight, mode="same")
    return image
