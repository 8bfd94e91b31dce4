"""Outlines of hands: of the posed meshes as a camera would see them, of masks in pictures, and pairs of both.

An outline's pixels are those of the hands that touch what is no hand; its normals point into the hands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import gaussian_filter, sobel
from scipy.sparse import csr_array
from scipy.spatial import KDTree
from torch import Tensor

from ...capture.masks.mask import load_opencv
from ...geometry.rasterise import nearest_fronts, rasterise
from ...records.camera import Camera
from ...records.hand_picture import HAND, UNKNOWN
from .rig_hands import RigHands

NONE = -1
"""The face of pixels that no mesh covers."""
_FRAME_PX = 3  # of the picture's own edge, which is no outline
_BLUR_PX = 2.0
_GLARE_PX, _GLARING, _LEAST_GROUND = 3.0, 0.85, 0.02  # its reach; the brightest channel, encoded; a share of pixels
_MARGIN_PX = 8
_FAR_M = 1e3
_NORMAL_MM = 10.0  # by which opposite normals count as apart, halved
_LARGEST_WEIGHT = 3.0  # of a barycentric at a pixel's centre that lies beside its thin face


class Outline(NamedTuple):
    """N pixels: centre [N, 2] px, unit normal [N, 2] into the region, row and column [N]."""

    px: np.ndarray
    normal: np.ndarray
    row: np.ndarray
    column: np.ndarray

    @property
    def rim_px(self) -> np.ndarray:
        """Where the region ends, [N, 2]: half a pixel outside these pixels' centres."""
        return self.px - 0.5 * self.normal


@dataclass(frozen=True)
class CoveredPixels:
    """What the nearest meshes cover in a picture: face [H, W], `NONE` without one, and depth [H, W] m, 1000 there."""

    face: Int[np.ndarray, "H W"]
    depth: Float[np.ndarray, "H W"]


def covered_pixels(vertices: Float[np.ndarray, "V 3"], faces: Tensor, camera: Camera) -> CoveredPixels:
    """Rasterise world vertices, m, within the box that holds them."""
    px, depth = camera.project(vertices)
    width, height = camera.size_px
    face = np.full((height, width), NONE)
    nearest = np.full((height, width), _FAR_M)
    low = np.clip(np.floor(np.nanmin(px, 0)) - _MARGIN_PX, 0, camera.size_px).astype(int)
    high = np.clip(np.ceil(np.nanmax(px, 0)) + _MARGIN_PX, 0, camera.size_px).astype(int)
    size_px = (int(high[0] - low[0]), int(high[1] - low[1]))
    if min(size_px) > 0:
        own = torch.as_tensor(px - low, dtype=torch.float32), torch.as_tensor(depth, dtype=torch.float32)
        front = nearest_fronts(rasterise(*own, faces, size_px), size_px)
        box = (slice(low[1], high[1]), slice(low[0], high[0]))
        face[box] = front.face.numpy().reshape(size_px[1], size_px[0])
        nearest[box] = front.depth.clamp(max=_FAR_M).numpy().reshape(size_px[1], size_px[0])
    return CoveredPixels(face, nearest)


def outline_of(region: Bool[np.ndarray, "H W"]) -> Outline:
    """Find the outline of a region."""
    around = np.pad(~region, 1)
    touches = np.zeros_like(region)
    height, width = region.shape
    for down in range(3):
        for right in range(3):
            touches |= around[down : down + height, right : right + width]
    edge = region & touches
    edge[:_FRAME_PX] = edge[-_FRAME_PX:] = False
    edge[:, :_FRAME_PX] = edge[:, -_FRAME_PX:] = False
    row, column = np.nonzero(edge)
    if not len(row):
        return Outline(np.zeros((0, 2)), np.zeros((0, 2)), row, column)
    box = tuple(slice(max(0, at.min() - _MARGIN_PX), at.max() + 1 + _MARGIN_PX) for at in (row, column))
    smooth = gaussian_filter(region[box].astype(np.float32), _BLUR_PX, mode="nearest")
    slope = np.stack([sobel(smooth, 1, mode="nearest"), sobel(smooth, 0, mode="nearest")], -1)
    normal = slope[row - box[0].start, column - box[1].start].astype(float)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-6
    return Outline(np.stack([column, row], 1) + 0.5, normal, row, column)


def outline_of_mask(labels: UInt8[np.ndarray, "H W"], is_known: Bool[np.ndarray, "H W"]) -> Outline:
    """Find the outline of the hand in a picture's labels, where they tell it from its ground."""
    return outline_where(labels == HAND, is_known)


def outline_where(region: Bool[np.ndarray, "H W"], is_known: Bool[np.ndarray, "H W"]) -> Outline:
    """Find the outline of a region, where it is known."""
    outline = outline_of(region)
    is_sure = is_known[outline.row, outline.column]
    return Outline(*(part[is_sure] for part in outline))


def tells_edges(rgb: UInt8[np.ndarray, "H W 3"], is_ground: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """Find the pixels of a picture, sRGB-encoded, that have no bright ground near by.

    Such a ground shines over the edges of what is before it, which looks thinner than it is.
    """
    cv2 = load_opencv()
    ground = is_ground.astype(np.float32)
    brightness = rgb.max(-1).astype(np.float32) / 255
    share, bright = (cv2.GaussianBlur(image, (0, 0), _GLARE_PX) for image in (ground, ground * brightness))
    return (share < _LEAST_GROUND) | (bright < _GLARING * share)


def sure_pixels(labels: UInt8[np.ndarray, "H W"], margin_px: int) -> Bool[np.ndarray, "H W"]:
    """Find the pixels that are known, so many pixels away from what is not."""
    unknown = (labels == UNKNOWN).astype(np.uint8)
    return load_opencv().dilate(unknown, np.ones((margin_px, margin_px))) == 0


class OutlineTree:
    """The outline of a picture, searched by place and direction."""

    def __init__(self, outline: Outline, px_per_mm: float, is_known: Bool[np.ndarray, "H W"] | None = None):
        """Build it.

        Args:
            outline: of the picture.
            px_per_mm: px in a millimetre at the hands.
            is_known: where the picture tells hand from ground; elsewhere nothing is near. None: everywhere.
        """
        self._outline, self._bend_px, self._is_known = outline, _NORMAL_MM * px_per_mm, is_known
        self._tree = KDTree(np.c_[outline.px, outline.normal * self._bend_px]) if len(outline.px) else None

    def nearest(self, outline: Outline) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find the nearest pixel of each pixel of an outline: distance [N] px, place [N, 2] and normal [N, 2]."""
        if self._tree is None or not len(outline.px):
            empty = np.zeros((len(outline.px), 2))
            return np.full(len(outline.px), np.inf), empty, empty
        distance, index = self._tree.query(np.c_[outline.px, outline.normal * self._bend_px])
        if self._is_known is not None:
            distance = np.where(self._is_known[outline.row, outline.column], distance, np.inf)
        return distance, self._outline.px[index], self._outline.normal[index]


class OutlinedGeometry(NamedTuple):
    """The surface of posed hands that views show: their meshes, or a finer one that moves with them.

    Attributes:
        vertices: [N, 3] m, world.
        faces: [M, 3].
        arm_faces: [M] bool, which have a vertex of the forearm.
        sums: [N, V]: vertices move as these sums of the meshes' do; None: they are the meshes'.
    """

    vertices: Float[np.ndarray, "N 3"]
    faces: Tensor
    arm_faces: Tensor
    sums: csr_array | None = None

    @classmethod
    def of_meshes(cls, vertices: Float[np.ndarray, "V 3"], hands: RigHands) -> OutlinedGeometry:
        """Take the meshes of all hands, vertices m, world."""
        return cls(vertices, hands.faces, hands.arm_faces)


class OutlinePairs(NamedTuple):
    """P points of a surface's outline in one view, and where the picture has it.

    Attributes:
        view: row of the view.
        px_per_mm: px in a millimetre at the hands.
        corners: [P, 3] vertices of the point's face, and `weights` [P, 3] its barycentrics.
        px: [P, 2] of the picture's outline, with `normal` [P, 2].
    """

    view: int
    px_per_mm: float
    corners: Tensor
    weights: Tensor
    px: Tensor
    normal: Tensor

    def off_mm(self, projected_px: Tensor) -> tuple[Tensor, Tensor]:
        """Measure projected points [P, 2] px across the picture's outline and along it, [P] and [P] mm."""
        off = projected_px - self.px
        across = (off * self.normal).sum(-1)
        along = (off - across[:, None] * self.normal).norm(dim=-1)
        return across / self.px_per_mm, along / self.px_per_mm


class PairedViews(NamedTuple):
    """The pairs of all views, and how their points follow the meshes' vertices.

    Attributes:
        views: that have pairs.
        matrix: sparse [all their P, V] that takes the meshes' vertices near their points.
        beside: [all their P, 3] m, world, from there to the points.
    """

    views: tuple[OutlinePairs, ...]
    matrix: Tensor
    beside: Tensor

    @classmethod
    def of(
        cls, views: Sequence[OutlinePairs], surface: OutlinedGeometry, vertices: Float[Tensor, "V 3"]
    ) -> PairedViews:
        """Stack the pairs of several views; views without any are left out.

        Args:
            views: pairs of the surface's points.
            surface: as it is.
            vertices: of the meshes, m, world.
        """
        views = tuple(part for part in views if len(part.px))
        total = sum(len(part.px) for part in views)
        values, columns = (
            np.concatenate([np.zeros((0, 3)), *(getattr(part, name).numpy() for part in views)]).ravel()
            for name in ("weights", "corners")
        )
        entries = values, (np.repeat(np.arange(total), 3), columns.astype(int))
        matrix = csr_array(entries, shape=(total, len(surface.vertices)))
        if surface.sums is None:
            return cls(views, _sparse(matrix), torch.zeros(total, 3))
        points, matrix = matrix @ surface.vertices, matrix @ surface.sums
        beside = torch.as_tensor(points - matrix @ vertices.double().numpy(), dtype=torch.float32)
        return cls(views, _sparse(matrix), beside)

    def points(self, vertices: Float[Tensor, "V 3"]) -> list[Tensor]:
        """Find the outlines' points [P, 3] of each view, m."""
        points = torch.sparse.mm(self.matrix, vertices) + self.beside
        return list(points.split([len(part.px) for part in self.views]))


def _sparse(matrix: csr_array) -> Tensor:
    entries = matrix.tocoo()
    index = torch.as_tensor(np.stack([entries.row, entries.col]).astype(np.int64))
    values = torch.as_tensor(entries.data, dtype=torch.float32)
    return torch.sparse_coo_tensor(index, values, matrix.shape, check_invariants=True).coalesce()


def outline_pairs(
    surface: OutlinedGeometry,
    camera: Camera,
    view: int,
    tree: OutlineTree,
    px_per_mm: float,
    reach_mm: float,
    arm_reach: float = 0.6,
    every: int = 1,
) -> OutlinePairs:
    """Pair the outline of posed hands with a picture's.

    Args:
        surface: of all hands.
        camera: of the view.
        view: its row.
        tree: of the picture's outline.
        px_per_mm: px in a millimetre at the hands.
        reach_mm: pairs that lie farther apart, in place and direction, are none.
        arm_reach: the share of it that counts for the forearm, whose sleeve is another outline.
        every: how many pixels of the outline share a pair.
    """
    covered = covered_pixels(surface.vertices, surface.faces, camera)
    outline = Outline(*(part[::every] for part in outline_of(covered.face != NONE)))
    face = covered.face[outline.row, outline.column]
    distance, px, normal = tree.nearest(outline)
    reach_px = reach_mm * px_per_mm * np.where(surface.arm_faces.numpy()[face], arm_reach, 1.0)
    corners = surface.faces.numpy()[face]
    weights = _screen_barycentrics(camera.project(surface.vertices[corners])[0], outline.px)
    keeps = (distance < reach_px) & (np.abs(weights).max(1, initial=0) < _LARGEST_WEIGHT)
    tensors = (torch.as_tensor(part[keeps], dtype=torch.float32) for part in (weights, px, normal))
    return OutlinePairs(view, px_per_mm, torch.as_tensor(corners[keeps]), *tensors)


def _screen_barycentrics(corners_px: Float[np.ndarray, "N 3 2"], px: Float[np.ndarray, "N 2"]) -> np.ndarray:
    first, second, at = corners_px[:, 1] - corners_px[:, 0], corners_px[:, 2] - corners_px[:, 0], px - corners_px[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    one = (at[:, 0] * second[:, 1] - at[:, 1] * second[:, 0]) / area
    two = (first[:, 0] * at[:, 1] - first[:, 1] * at[:, 0]) / area
    return np.stack([1 - one - two, one, two], 1)
