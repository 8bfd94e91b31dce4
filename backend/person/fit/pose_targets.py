"""Where a picture wants the mesh's vertices: by flow between what the model renders and the picture, and by outlines.

Once the model has about the person's skin and light, flow says for every visible vertex where it should be, but not how
far along a straight edge. A vertex at the hand's outline should lie on the mask's, somewhere: only its distance across
that edge counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from ...records.hand_picture import HAND, UNKNOWN, HandPicture
from ..lit_model.flow import bilinear, flow_between, flow_reliability, nearest
from ..lit_model.illumination import Illumination, encoded_colours
from ..lit_model.model import GeometryMaps, PersonModel
from ..rig.outlines import outline_of, outline_of_mask, sure_pixels

_ALONG_PX = 2.0  # of the outline: vertices so near to it belong to it
_FARTHEST_PX = 30.0
_LEAST_AGREEMENT = 0.5  # cosine of both edges' directions
_BESIDE_UNKNOWN_PX = 9
_MASK_SHARE = 0.2  # of grey that tells hand from backdrop in the flow
_FLOW_ERROR_PX, _BEHIND_M, _LEAST_FACING = 3.0, 0.004, 0.15


class OutlineTargets(NamedTuple):
    """K vertices at the outline: which, the points [K, 2] px where they should be, and the edge's unit normals [K, 2].

    A vertex should be as far inside the mask's edge as it is inside the surface's own.
    """

    vertex: np.ndarray
    px: np.ndarray
    normal: np.ndarray


def outline_targets(seen: GeometryMaps, labels: np.ndarray, vertices_px: np.ndarray) -> OutlineTargets:
    """Match the outline of the surface to that of a mask.

    Args:
        seen: of the surface in the picture.
        labels: [H, W] of the picture.
        vertices_px: [V, 2] the mesh's, projected.
    """
    ours, theirs = outline_of(seen.is_seen), outline_of_mask(labels, sure_pixels(labels, _BESIDE_UNKNOWN_PX))
    nothing = OutlineTargets(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)))
    if not len(ours.px) or not len(theirs.px):
        return nothing
    distance, at = (np.asarray(found) for found in KDTree(ours.rim_px).query(vertices_px))
    vertex = np.flatnonzero(distance < _ALONG_PX)
    rim, rim_px = at[vertex], ours.rim_px[at[vertex]]
    off, matched = (np.asarray(found) for found in KDTree(theirs.rim_px).query(rim_px))
    agrees = (ours.normal[rim] * theirs.normal[matched]).sum(1) > _LEAST_AGREEMENT
    kept = agrees & (off < _FARTHEST_PX)
    inside_px = vertices_px[vertex] - rim_px
    return OutlineTargets(vertex[kept], (theirs.rim_px[matched] + inside_px)[kept], theirs.normal[matched[kept]])


class PoseTargets(NamedTuple):
    """Where a picture wants the mesh's vertices.

    Attributes:
        px: [V, 2].
        weight: [V] 0 of those that it does not show.
        reliability: [V, 2, 2] what takes of a distance from there what the picture tells.
        outline: of vertices at the outline.
        flow_px: mean length of the flow.
        overlap: intersection over union of hand and mask, of what is known.
    """

    px: np.ndarray
    weight: np.ndarray
    reliability: np.ndarray
    outline: OutlineTargets
    flow_px: float
    overlap: float

    def enlarged(self, larger_by: np.ndarray) -> PoseTargets:
        """Return the targets in a picture larger by these factors [2] along x and y."""
        outline = self.outline._replace(px=self.outline.px * larger_by)
        flow_px = self.flow_px * float(np.mean(larger_by))
        return self._replace(px=self.px * larger_by, outline=outline, flow_px=flow_px)


def pose_targets(model: PersonModel, picture: HandPicture, light: Illumination) -> PoseTargets:
    """Find where a picture wants the vertices of its hand."""
    frame = model.rendered(picture.pose, picture.camera, light.light)
    seen = model.seen(picture.pose, picture.camera)
    vertices = model.vertices(picture.pose)
    px, depth = picture.camera.project(vertices)
    rendered = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint
    is_known, is_hand = (picture.labels != UNKNOWN), picture.labels == HAND
    ours = _grey(encoded_colours(picture, rendered), (seen.is_seen & is_known).astype(np.float32))
    theirs = _grey(picture.rgb.astype(np.float32) / 255, is_hand.astype(np.float32))
    flow = flow_between(ours, theirs, 1.5)
    visible = visible_vertices(seen, px, depth)
    weight = visible * np.exp(-(bilinear(flow.error_px, px) ** 2) / (2 * _FLOW_ERROR_PX**2))
    weight = weight * (nearest(picture.labels, px) != UNKNOWN)
    shift = bilinear(flow.px, px)
    length = float((np.linalg.norm(shift, axis=1) * visible).sum() / max(visible.sum(), 1))
    union = ((seen.is_seen & is_known) | is_hand).sum()
    overlap = float((seen.is_seen & is_hand).sum() / max(union, 1))
    outline = outline_targets(seen, picture.labels, px)
    return PoseTargets(px + shift, weight, flow_reliability(ours, px), outline, length, overlap)


def _grey(encoded: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return mask * ((1 - _MASK_SHARE) * encoded.mean(-1) + _MASK_SHARE)


def visible_vertices(seen: GeometryMaps, px: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Find (1) the vertices [V] that the picture shows, which lie on the surface or just below it."""
    shown = nearest(np.where(seen.is_seen, seen.depth, np.inf), px)
    height, width = seen.is_seen.shape
    inside = ((px >= 1) & (px < (width - 1, height - 1))).all(1)
    facing = nearest(np.where(seen.is_seen, seen.facing, 0), px)
    return (inside & np.isfinite(shown) & (depth < shown + _BEHIND_M) & (facing > _LEAST_FACING)).astype(np.float64)
