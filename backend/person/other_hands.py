"""Where hands are in a picture by their landmarks: what another one hides, or may, is unknown of the person's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..capture.masks.mask import load_opencv
from ..records.camera import Camera
from ..records.hand_picture import HAND, UNKNOWN

_WRIST, _MIDDLE_KNUCKLE, _INDEX_KNUCKLE, _PINKY_KNUCKLE = 0, 9, 5, 17
_PALM = (0, 1, 5, 9, 13, 17)
_FINGERS = tuple(range(first, first + 4) for first in (1, 5, 9, 13, 17))
_FINGER_WIDTH, _PALM_MARGIN, _ARM_WIDTH, _ARM_LENGTH = 0.26, 0.3, 0.7, 2.0  # of the palm's length in the picture
_MAY_BE_OFF, _ARM_BENDS_RAD = 0.25, (-0.5, 0.0, 0.5)  # of the palm's length, and to each side
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
    others, arms = np.zeros(labels.shape, np.uint8), np.zeros(labels.shape, np.uint8)
    for px in others_px:
        _draw(others, arms, px)
    others |= arms * ~silhouette  # arms are drawn straight, and seldom lie before a hand
    if not others.any():
        return labels
    to_others, to_mesh = (
        cv2.distanceTransform((1 - region).astype(np.uint8), cv2.DIST_L2, 5)
        for region in (others, silhouette.astype(np.uint8))
    )
    is_theirs = (labels == HAND) & ~silhouette & (to_others < to_mesh)
    return np.where((others > 0) | is_theirs, UNKNOWN, labels).astype(np.uint8)


def where_hands_may_be(hands_px: Sequence[np.ndarray], size_px: tuple[int, int]) -> np.ndarray:
    """Draw all that hands and their arms may cover, however wrists are bent, into a region [H, W], rather too wide.

    Args:
        hands_px: [21, 2] landmarks of each hand.
        size_px: (width, height) of the picture.
    """
    cv2 = load_opencv()
    covered = np.zeros(size_px[::-1], np.uint8)
    for px in hands_px:
        one = np.zeros_like(covered)
        for bend_rad in _ARM_BENDS_RAD:
            _draw(one, one, px, bend_rad)
        radius = max(1, round(_MAY_BE_OFF * _palm_px(px)))
        covered |= cv2.dilate(one, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)))
    return covered > 0


def _palm_px(px: np.ndarray) -> float:
    """Measure a palm, whose length or width may point at the camera."""
    along, across = px[_WRIST] - px[_MIDDLE_KNUCKLE], px[_INDEX_KNUCKLE] - px[_PINKY_KNUCKLE]
    return max(float(np.linalg.norm(along)), float(np.linalg.norm(across)), 1.0)


def _draw(hand: np.ndarray, arm: np.ndarray, landmarks_px: np.ndarray, bend_rad: float = 0.0) -> None:
    """Draw a hand and the beginning of its arm into regions, a little too wide."""
    cv2 = load_opencv()
    px = landmarks_px.clip(-_MOST_PX, _MOST_PX)
    length = _palm_px(px)
    turn = np.array([[np.cos(bend_rad), -np.sin(bend_rad)], [np.sin(bend_rad), np.cos(bend_rad)]])
    elbow = px[_WRIST] + _ARM_LENGTH * turn @ (px[_WRIST] - px[_MIDDLE_KNUCKLE])
    palm = cv2.convexHull(px[list(_PALM)].round().astype(np.int32))
    cv2.fillConvexPoly(hand, palm, 1)

    def line(region: np.ndarray, points: np.ndarray, is_closed: bool, width: float) -> None:
        cv2.polylines(region, [points.round().astype(np.int32)], is_closed, 1, max(1, round(width * length)))

    line(hand, palm[:, 0], True, _PALM_MARGIN)
    line(arm, np.stack([px[_WRIST], elbow]), False, _ARM_WIDTH)
    for finger in _FINGERS:
        line(hand, px[list(finger)], False, _FINGER_WIDTH)
