"""What rises on an invented person's hand: veins, and flesh in the hollows between the metacarpals.

A ball that rolls over the back across the hand dips so far between two metacarpals; flesh fills a share of what it
leaves free, more of some people than of others. Valleys between the fingers' roots that are tighter than the mesh
resolves, whose triangles would shine as beads, are rounded in everybody. The web beside the thumb bulges as thumb and
index finger bend, where a fist would be seen through.
"""

from __future__ import annotations

import numpy as np

from ..detail_mesh import DetailTemplate
from ..detail_surface import PoseForm
from .hand_chart import HandChart, bump, smoothstep
from .look import PersonLook
from .skin_lines import PlaneImage, plane

_START_MM, _END_MM, _TEXEL_MM = (0.0, -44.0), (96.0, 44.0), 1.0
_BALL_MM, _REACH_MM = 250.0, 14
_SPREAD_MM = 1.6  # deviation of the weights of vertices around a texel, and of what smooths the padding
_ON_BACK = 0.3, 0.6  # of the normal's dorsal part
_MOST_MM, _LEAST_COUNT = 3.0, 1e-4
# Where along the hand and how far across it the outermost metacarpals lie, and how wide each is.
_LITTLE_RAY_MM, _INDEX_RAY_MM, _AT_RAY_MM = ((25.0, 77.0), (-17.0, -31.0)), ((27.0, 92.0), (12.0, 25.5)), 5.0

# Along a finger from its knuckle, where valleys beside it are rounded; in which steps, up to which sagitta of an edge.
_VALLEY_MM, _VALLEY_STEPS, _ROUND_MM = ((-30.0, -18.0), (26.0, 18.0)), 40, 0.06

# The thumb's web: middle and deviation along, across and over the hand, and how far it rises in all.
_WEB_MM, _WEB_WIDE_MM, _WEB_RISE_MM = (57.0, 36.0, -8.0), (13.0, 12.0, 13.0), 10.0
_WEB_RAISED_BY = (
    (14, 12.0, 28.0),
    (1, 30.0, 75.0),
) * 2  # bends of the thumb and of the index finger; 3 mm each at most


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


def rounded_valleys_mm(template: DetailTemplate, chart: HandChart, padding_mm: np.ndarray) -> np.ndarray:
    """Compute how high [N] flesh rises at rest so that the valleys between the fingers' roots are round, mm.

    Args:
        template: of the surface.
        chart: at its vertices.
        padding_mm: [N] that rises already, and is part of the result.
    """
    edges = np.concatenate([template.faces.numpy()[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    start, end = np.concatenate([edges, edges[:, ::-1]]).T  # an edge of two faces is there twice in both directions
    normals, count = template.normals.numpy(), np.bincount(start, minlength=len(padding_mm))
    along = chart.from_joint_mm[:, 0]
    beside = np.where(chart.is_thumb, 0, np.prod([smoothstep(along, *ends) for ends in _VALLEY_MM], 0))
    share = 0.5 * beside * (1 - chart.palm)
    rest_mm, height = 1e3 * template.rest_vertices().numpy(), padding_mm.astype(np.float64)
    for _ in range(_VALLEY_STEPS):
        risen = rest_mm + height[:, None] * normals
        mean = np.stack([np.bincount(start, risen[end, k], len(height)) for k in range(3)], 1) / count[:, None]
        sagitta = ((mean - risen) * normals).sum(1)
        height += share * (sagitta - _ROUND_MM).clip(0)
    return height.clip(None, _MOST_MM)


def web_forms(chart: HandChart) -> tuple[PoseForm, ...]:
    """Make the forms that raise the thumb's web: half of it as the thumb bends, half as the index finger does."""
    place_mm = np.column_stack([plane(chart.points_mm), chart.points_mm[:, 1]])
    ahead = smoothstep(-chart.normals[:, 0], -0.5, 0.5)
    share = ahead * bump(np.linalg.norm((place_mm - _WEB_MM) / _WEB_WIDE_MM, axis=1), 1.0)
    height_mm = (_WEB_RISE_MM / len(_WEB_RAISED_BY) * share).astype(np.float32)
    return tuple(PoseForm(*bend, height_mm) for bend in _WEB_RAISED_BY)


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
