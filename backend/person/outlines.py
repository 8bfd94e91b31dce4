"""Outlines as targets: where the edge of a rendered hand meets the edge of a picture's mask.

A vertex at the hand's outline should lie on the mask's, somewhere: only its distance across that edge counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from ..capture.masks.mask import load_opencv
from .model import SeenSurface
from .picture import HAND, UNKNOWN

_ALONG_PX = 2.0  # of the outline: vertices so near to it belong to it
_FARTHEST_PX = 30.0
_LEAST_AGREEMENT = 0.5  # cosine of both edges' directions
_BLUR_PX = 2.0
_BESIDE_UNKNOWN_PX = 9


class OutlineTargets(NamedTuple):
    """K vertices at the outline: which, the points [K, 2] px of the mask's edge, and its unit normals [K, 2] there."""

    vertex: np.ndarray
    px: np.ndarray
    normal: np.ndarray


def outline_targets(seen: SeenSurface, labels: np.ndarray, vertices_px: np.ndarray) -> OutlineTargets:
    """Match the outline of the surface to that of a mask.

    Args:
        seen: of the surface in the picture.
        labels: [H, W] of the picture.
        vertices_px: [V, 2] the mesh's, projected.
    """
    ours, theirs = _edge(seen.is_seen, None), _edge(labels == HAND, labels == UNKNOWN)
    nothing = OutlineTargets(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)))
    if not len(ours.px) or not len(theirs.px):
        return nothing
    distance, at = KDTree(ours.px).query(vertices_px)
    vertex = np.flatnonzero(distance < _ALONG_PX)
    found, nearest = KDTree(theirs.px).query(vertices_px[vertex])
    agrees = (ours.normal[at[vertex]] * theirs.normal[nearest]).sum(1) > _LEAST_AGREEMENT
    kept = agrees & (found < _FARTHEST_PX)
    return OutlineTargets(vertex[kept], theirs.px[nearest[kept]], theirs.normal[nearest[kept]])


class _Edge(NamedTuple):
    px: np.ndarray
    normal: np.ndarray


def _edge(mask: np.ndarray, unknown: np.ndarray | None) -> _Edge:
    """Find the points of a mask's edge and its normals there, away from the picture's rim and from what is unknown."""
    cv2 = load_opencv()
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), _BLUR_PX)
    inside = mask.astype(np.uint8)
    is_edge = (inside > 0) & (cv2.erode(inside, np.ones((3, 3)), borderValue=1) == 0)
    is_edge[[0, -1]] = is_edge[:, [0, -1]] = False
    if unknown is not None and unknown.any():
        around = np.ones((_BESIDE_UNKNOWN_PX, _BESIDE_UNKNOWN_PX))
        is_edge &= cv2.dilate(unknown.astype(np.uint8), around) == 0
    row, column = is_edge.nonzero()
    slope = np.stack([cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], -1)[row, column]
    normal = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
    return _Edge(np.stack([column, row], 1) + 0.5 - 0.5 * normal, normal)
