"""Finds palms in a whole picture: the detector's anchors, what its numbers mean, and overlapping finds made one."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import UInt8

from .crop import HandRegion, cropped, region_of_extent, upward_angle
from .networks import TorchNetwork

_GRIDS = ((24, 2), (12, 6))  # cells per side, anchors per cell
_LEAST_SCORE = 0.5
_MOST_OVERLAP = 0.3  # of two finds of different palms
_LARGEST_LOGIT = 100.0
_WRIST, _MIDDLE_KNUCKLE = 0, 2  # among a palm's seven points
_PALM_SCALE, _PALM_SHIFT = 2.6, -0.5  # of a hand's region against its palm's box


def find_hands(picture: UInt8[np.ndarray, "H W 3"], detector: TorchNetwork) -> list[HandRegion]:
    """Regions of the hands in a picture, the surest first."""
    height, width = picture.shape[:2]
    whole = HandRegion(np.array([width, height]) / 2, float(max(width, height)), 0.0)
    boxes, logits = detector(cropped(picture, whole, detector.size_px, repeats_edge=False))
    scores = 1 / (1 + np.exp(-np.clip(logits[0, :, 0].numpy(), -_LARGEST_LOGIT, _LARGEST_LOGIT)))
    is_palm = scores >= _LEAST_SCORE
    palms = _decoded(boxes[0].numpy()[is_palm], _anchors()[is_palm], detector.size_px)
    return [_region(whole.to_px(palm)) for palm in merged(palms, scores[is_palm])]


def merged(palms: np.ndarray, scores: np.ndarray) -> list[np.ndarray]:
    """Weighted non-maximum suppression: overlapping finds become their mean, weighted by score.

    Args:
        palms: [N, 9, 2] upper left and lower right corner of the box, then the palm's points.
        scores: [N] in (0, 1).
    """
    rest, found = np.argsort(-scores, kind="stable"), []
    while len(rest):
        same = _overlaps(palms[rest[0]], palms[rest]) > _MOST_OVERLAP
        same[0] = True
        found.append(np.average(palms[rest[same]], 0, scores[rest[same]]))
        rest = rest[~same]
    return found


@cache
def _anchors() -> np.ndarray:
    """[2016, 2] centres, shares of the picture, row by row."""
    grids = []
    for cells, count in _GRIDS:
        rows, columns = np.divmod(np.arange(cells * cells), cells)
        grids.append(np.repeat((np.stack([columns, rows], 1) + 0.5) / cells, count, 0))
    return np.concatenate(grids)


def _decoded(raw: np.ndarray, anchors: np.ndarray, size_px: int) -> np.ndarray:
    """[N, 9, 2] shares of the picture: both corners of the box, then seven points."""
    pairs = raw.reshape(len(raw), 9, 2) / size_px
    centre, half = pairs[:, 0] + anchors, pairs[:, 1] / 2
    return np.concatenate([(centre - half)[:, None], (centre + half)[:, None], pairs[:, 2:] + anchors[:, None]], 1)


def _overlaps(one: np.ndarray, palms: np.ndarray) -> np.ndarray:
    """[N] intersection over union of one box with others."""
    low, high = np.maximum(one[0], palms[:, 0]), np.minimum(one[1], palms[:, 1])
    shared = np.maximum(high - low, 0).prod(-1)
    both = np.prod(one[1] - one[0]) + (palms[:, 1] - palms[:, 0]).prod(-1) - shared
    return shared / np.maximum(both, np.finfo(float).tiny)


def _region(palm_px: np.ndarray) -> HandRegion:
    low, high, points = palm_px[0], palm_px[1], palm_px[2:]
    angle = upward_angle(points[_WRIST], points[_MIDDLE_KNUCKLE])
    return region_of_extent((low + high) / 2, high - low, angle, _PALM_SCALE, _PALM_SHIFT)
