"""Finds palms, and so the regions of hands, in a picture: MediaPipe's detector, and what its answers mean."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

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
_FARTHER = (2.0, 2.5, 1.5)  # than the whole picture
_TURNS_RAD = (pi / 2, -pi / 2, pi)


def find_hands(
    picture: UInt8[np.ndarray, "H W 3"], detector: TorchNetwork, view: HandRegion | None = None
) -> list[HandRegion]:
    """Find the regions of the hands in a square view of a picture (None: around all of it), the surest first."""
    view = view or around(picture)
    boxes, logits = detector(cropped(picture, view, detector.size_px, repeats_edge=False))
    scores = 1 / (1 + np.exp(-np.clip(logits[0, :, 0].numpy(), -_LARGEST_LOGIT, _LARGEST_LOGIT)))
    is_palm = scores >= _LEAST_SCORE
    palms = _decoded(boxes[0].numpy()[is_palm], _anchors()[is_palm], detector.size_px)
    return [_region(palm, view) for palm in merged(palms, scores[is_palm])]


def around(picture: np.ndarray) -> HandRegion:
    """Return the upright square around a picture."""
    height, width = picture.shape[:2]
    return HandRegion(np.array([width, height]) / 2, float(max(width, height)), 0.0)


def other_views(picture: np.ndarray) -> list[HandRegion]:
    """List the views in which hands are looked for where the whole, upright picture shows none; the likelier first.

    The detector knows palms of a fifth of its view, rather upright. From twice as far, a hand that fills the picture is
    such a one; in the picture's nine overlapping quarters, a far hand is. Each view is turned by quarters, too.
    """
    whole = around(picture)
    far = [
        replace(whole, side_px=scale * whole.side_px, angle_rad=angle)
        for scale in _FARTHER
        for angle in (0.0, *_TURNS_RAD)
    ]
    turned = [replace(whole, angle_rad=angle) for angle in _TURNS_RAD]
    steps, step_px = (0, -1, 1), np.array(picture.shape[1::-1]) / 4
    centres_px = [whole.centre_px + step_px * (x, y) for y in steps for x in steps]
    near = [HandRegion(centre_px, whole.side_px / 2, angle) for angle in (0.0, *_TURNS_RAD) for centre_px in centres_px]
    return [*far, *turned, *near]


def merged(palms: np.ndarray, scores: np.ndarray) -> list[np.ndarray]:
    """Apply weighted non-maximum suppression: overlapping detections become their mean, weighted by score.

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
    """List the anchors: [2016, 2] centres, shares of the picture, row by row."""
    grids = []
    for cells, count in _GRIDS:
        rows, columns = np.divmod(np.arange(cells * cells), cells)
        grids.append(np.repeat((np.stack([columns, rows], 1) + 0.5) / cells, count, 0))
    return np.concatenate(grids)


def _decoded(raw: np.ndarray, anchors: np.ndarray, size_px: int) -> np.ndarray:
    """Decode to [N, 9, 2] shares of the picture: both corners of the box, then seven points."""
    pairs = raw.reshape(len(raw), 9, 2) / size_px
    centre, half = pairs[:, 0] + anchors, pairs[:, 1] / 2
    return np.concatenate([(centre - half)[:, None], (centre + half)[:, None], pairs[:, 2:] + anchors[:, None]], 1)


def _overlaps(one: np.ndarray, palms: np.ndarray) -> np.ndarray:
    """Compute the intersection over union [N] of one box with others."""
    low, high = np.maximum(one[0], palms[:, 0]), np.minimum(one[1], palms[:, 1])
    shared = np.maximum(high - low, 0).prod(-1)
    both = np.prod(one[1] - one[0]) + (palms[:, 1] - palms[:, 0]).prod(-1) - shared
    return shared / np.maximum(both, np.finfo(float).tiny)


def _region(palm: np.ndarray, view: HandRegion) -> HandRegion:
    """Return the region of the hand of a palm [9, 2], shares of a view: two corners, then seven points."""
    px = view.to_px(palm)
    angle = upward_angle(px[2 + _WRIST], px[2 + _MIDDLE_KNUCKLE])
    extent_px = np.abs(px[1] - px[0])  # views are turned by quarters, and palms' boxes are squares
    return region_of_extent((px[0] + px[1]) / 2, extent_px, angle, _PALM_SCALE, _PALM_SHIFT)
