"""Where a photographed hand is in its image: the posed mesh says about where, GrabCut where its edge is.

Rother et al. 2004, "GrabCut". The mesh's silhouette, eroded, is surely hand; far from it nothing is; between the two
GrabCut decides by colour. A fit is off by millimetres, so both distances are given in them. The forearm, which the mesh
ends at, looks like hand: it counts as such while colours are learnt, and is cut off along the mesh's end afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from ...geometry.rasterise import rasterise
from ...geometry.tolerances import NEAR_M
from ...records.camera import Camera
from ...records.errors import LiveHandError

_WRIST, _KNUCKLE = 0, 4  # joints: the forearm goes on where these two point
_STUMP = 0.1  # of the hand's length, at its end: what the forearm grows out of
_FOREARM_WIDER = 1.2  # than the mesh's end: a forearm widens, and the fit is off
_MARGIN_PX = 24  # of background around all that may be hand


@dataclass(frozen=True)
class MaskConfig:
    """How far the fit is trusted."""

    erode_mm: float = 4.0
    """Deeper than this inside the silhouette all is hand; fingers are some 15 mm wide."""
    dilate_mm: float = 12.0
    """Farther than this outside it nothing is."""
    forearm_mm: float = 150.0
    """How far the forearm is followed."""
    iterations: int = 5
    """Of GrabCut."""


class MaskRegions(NamedTuple):
    """Of an image [H, W], bool: the mesh's silhouette; surely hand; maybe hand; forearm outside the silhouette."""

    silhouette: np.ndarray
    core: np.ndarray
    near: np.ndarray
    forearm: np.ndarray


def load_opencv() -> ModuleType:
    """OpenCV, which only masks need.

    Raises:
        LiveHandError: not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise LiveHandError(
            f'masks are made with OpenCV, which is missing ({error}); install it with: pip install "livehand[masks]"'
        ) from error
    return cv2


def hand_regions(
    vertices: Float[np.ndarray, "V 3"],
    joints: Float[np.ndarray, "16 3"],
    faces: np.ndarray,
    camera: Camera,
    config: MaskConfig,
) -> MaskRegions:
    """What a posed hand (m, world) says of its image."""
    cv2 = load_opencv()
    silhouette = _silhouette(vertices, faces, camera)
    focal_px, depth_m = np.abs(camera.K.diagonal()[:2]), np.median(camera.project(vertices)[1])
    px_of_mm = focal_px / max(depth_m, NEAR_M) / 1000  # along x and y
    core = _grown(silhouette, -config.erode_mm * px_of_mm)
    forearm = _forearm(vertices, joints, camera, config.forearm_mm / 1000)
    is_hand = silhouette.astype(np.uint8)
    outline = cv2.dilate(is_hand, np.ones((3, 3), np.uint8)) > 0  # the edge's own pixels stay the hand's
    return MaskRegions(
        silhouette=silhouette,
        core=core if core.any() else silhouette,
        near=_grown(silhouette, config.dilate_mm * px_of_mm),
        forearm=forearm & ~outline,
    )


def grabcut_mask(
    image: UInt8[np.ndarray, "H W 3"], regions: MaskRegions, config: MaskConfig
) -> Bool[np.ndarray, "H W"]:
    """Where the hand is in an sRGB-encoded image; deterministic."""
    mask = np.zeros(regions.silhouette.shape, bool)
    if not regions.silhouette.any():
        return mask
    window = _window(regions.near | regions.forearm)
    found = _cut(image[window], MaskRegions(*(region[window] for region in regions)), config)
    mask[window] = _largest_component((found | regions.core[window]) & ~regions.forearm[window])
    return mask


def _silhouette(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> np.ndarray:
    width, height = camera.size_px
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    fragments = rasterise(positions_px, depth, torch.as_tensor(faces), camera.size_px)
    silhouette = np.zeros(height * width, bool)
    silhouette[fragments.pixel.numpy()] = True
    return silhouette.reshape(height, width)


def _forearm(vertices: np.ndarray, joints: np.ndarray, camera: Camera, length_m: float) -> np.ndarray:
    """The hull of the mesh's end and of its copy, larger, farther along the forearm."""
    cv2 = load_opencv()
    direction = joints[_WRIST] - joints[_KNUCKLE]
    direction = direction / np.linalg.norm(direction)
    along = vertices @ direction
    end = vertices[along > along.max() - _STUMP * np.ptp(along)]
    flat = end + (along.max() - end @ direction)[:, None] * direction  # pushed to the very end
    copy = flat.mean(0) + _FOREARM_WIDER * (flat - flat.mean(0)) + length_m * direction
    region = np.zeros(camera.size_px[::-1], np.uint8)
    positions_px, depth = camera.project(np.concatenate([flat, copy]))
    if (depth > NEAR_M).all():
        limit = 8.0 * max(camera.size_px)  # OpenCV counts in 32-bit integers
        hull = cv2.convexHull(positions_px.clip(-limit, limit).round().astype(np.int32))
        cv2.fillConvexPoly(region, hull, 1)
    return region > 0


def _grown(region: np.ndarray, distance_px: np.ndarray) -> np.ndarray:
    """Grown, or shrunk, by a distance along x and y of at least one pixel."""
    cv2 = load_opencv()
    radius = np.maximum(np.abs(distance_px).round(), 1).astype(int)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, tuple((2 * radius + 1).tolist()))
    change = cv2.dilate if distance_px[0] > 0 else cv2.erode
    return change(region.astype(np.uint8), kernel) > 0


def _window(region: np.ndarray) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(region.any(axis)) for axis in (1, 0))
    return tuple(slice(max(0, int(at[0]) - _MARGIN_PX), int(at[-1]) + 1 + _MARGIN_PX) for at in (rows, columns))  # type: ignore[return-value]


def _cut(image: np.ndarray, regions: MaskRegions, config: MaskConfig) -> np.ndarray:
    cv2 = load_opencv()
    labels = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    labels[regions.near] = cv2.GC_PR_BGD
    labels[regions.silhouette | regions.forearm] = cv2.GC_PR_FGD
    labels[regions.core] = cv2.GC_FGD
    if not np.isin(labels, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        return regions.silhouette
    cv2.setRNGSeed(0)  # GrabCut's first colour clusters are drawn
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(image), labels, None, *models, config.iterations, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def _largest_component(mask: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return mask
    return labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()
