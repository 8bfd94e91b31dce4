"""Where another hand is in a picture: what it hides, or may, is unknown of the person's hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..capture.masks.mask import load_opencv
from ..records.camera import Camera
from .hand_picture import HAND, UNKNOWN

_WRIST, _MIDDLE_KNUCKLE, _INDEX_KNUCKLE, _PINKY_KNUCKLE = 0, 9, 5, 17
_PALM = (0, 1, 5, 9, 13, 17)
_FINGERS = tuple(range(first, first + 4) for first in (1, 5, 9, 13, 17))
_FINGER_WIDTH, _PALM_MARGIN, _ARM_WIDTH, _ARM_LENGTH = 0.26, 0.3, 0.7, 2.0  # of the palm's length in the picture
_MOST_PX = 1 << 14  # of coordinates that are drawn


def in_window(px: np.ndarray, whole: Camera, part: Camera) -> np.ndarray:
    """Convert points [..., 2] of a camera's picture to those of a part of it, which has its own size."""
    to_part = part.K @ np.linalg.inv(whole.K)
    return px @ to_part[:2, :2].T + to_part[:2, 2]


def with_others_unknown(labels: np.ndarray, silhouette: np.ndarray, others_px: Sequence[np.ndarray]) -> np.ndarray:
    """Return labels [H, W] in which other hands are unknown, and skin that is nearer to them than to the mesh.

    Args:
        labels: of the person's hand.
        silhouette: bool [H, W], of its posed mesh.
        others_px: [21, 2] landmarks of each other hand in the picture.
    """
    if not len(others_px):
        return labels
    cv2 = load_opencv()
    others = np.zeros(labels.shape, np.uint8)
    for px in others_px:
        _draw(others, px)
    if not others.any():
        return labels
    to_others, to_mesh = (
        cv2.distanceTransform((1 - region).astype(np.uint8), cv2.DIST_L2, 5)
        for region in (others, silhouette.astype(np.uint8))
    )
    is_theirs = (labels == HAND) & ~silhouette & (to_others < to_mesh)
    return np.where((others > 0) | is_theirs, UNKNOWN, labels).astype(np.uint8)


def _draw(region: np.ndarray, landmarks_px: np.ndarray) -> None:
    """Draw a hand and the beginning of its arm into a region, a little too wide."""
    cv2 = load_opencv()
    px = landmarks_px.clip(-_MOST_PX, _MOST_PX)
    along = px[_WRIST] - px[_MIDDLE_KNUCKLE]
    length = max(float(np.linalg.norm(along)), float(np.linalg.norm(px[_INDEX_KNUCKLE] - px[_PINKY_KNUCKLE])), 1.0)
    elbow = px[_WRIST] + _ARM_LENGTH * along
    palm = cv2.convexHull(px[list(_PALM)].round().astype(np.int32))
    cv2.fillConvexPoly(region, palm, 1)
    lines = [(palm[:, 0], True, _PALM_MARGIN), (np.stack([px[_WRIST], elbow]), False, _ARM_WIDTH)]
    lines += [(px[list(finger)], False, _FINGER_WIDTH) for finger in _FINGERS]
    for points, is_closed, width in lines:
        cv2.polylines(region, [points.round().astype(np.int32)], is_closed, 1, max(1, round(width * length)))
