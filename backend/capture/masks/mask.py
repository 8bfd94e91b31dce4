"""The mask of a photographed hand: the posed mesh locates the hand, GrabCut finds its edge.

Rother et al. 2004, "GrabCut". The eroded silhouette of the mesh is certainly hand, and pixels far from it are certainly
background; between the two GrabCut decides by colour. Both distances are in millimetres, like the errors of a fit. The
forearm, where the mesh ends, has the colours of the hand: it counts as hand while the colour models are fitted, and is
cut off along the mesh's end afterwards.
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
from ...hand.model import HandModel
from ...records.camera import Camera
from ...records.errors import LiveHandError

_WRIST, _KNUCKLE = 0, 4  # joints: the forearm lies in the direction from the knuckle to the wrist
_STUMP = 0.1  # share of the hand's length at the wrist from which the forearm continues
_FOREARM_WIDENING = 1.2  # relative to the mesh's end
_MARGIN_PX = 24  # of background around the possible hand


@dataclass(frozen=True)
class MaskConfig:
    """How far the mesh is trusted."""

    erode_mm: float = 4.0
    """Pixels deeper inside the silhouette are hand; fingers are about 15 mm wide."""
    dilate_mm: float = 12.0
    """Pixels farther outside the silhouette are background."""
    forearm_mm: float = 150.0
    """Length of the forearm that is considered."""
    ends_at_wrist: bool = False
    """An arm that the model has is no part of the mask, as if the mesh ended behind the wrist."""
    iterations: int = 5
    """Iterations of GrabCut."""


class MaskRegions(NamedTuple):
    """Bool [H, W]: the mesh's silhouette, certain hand, possible hand, and the forearm outside the silhouette."""

    silhouette: np.ndarray
    core: np.ndarray
    near: np.ndarray
    forearm: np.ndarray


def load_opencv() -> ModuleType:
    """Import OpenCV, which only masks need.

    Raises:
        LiveHandError: OpenCV is not installed.
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
    """Divide an image of a posed hand into regions; vertices and joints in m, world."""
    cv2 = load_opencv()
    silhouette = _silhouette(vertices, faces, camera)
    focal_px, depth_m = np.abs(camera.K.diagonal()[:2]), np.median(camera.project(vertices)[1])
    px_of_mm = focal_px / max(depth_m, NEAR_M) / 1000  # along x and y
    core = _dilated(silhouette, -config.erode_mm * px_of_mm)
    forearm = _forearm(vertices, joints, camera, config.forearm_mm / 1000)
    is_hand = silhouette.astype(np.uint8)
    outline = cv2.dilate(is_hand, np.ones((3, 3), np.uint8)) > 0  # the pixels of the edge belong to the hand
    return MaskRegions(
        silhouette=silhouette,
        core=core if core.any() else silhouette,
        near=_dilated(silhouette, config.dilate_mm * px_of_mm),
        forearm=forearm & ~outline,
    )


def grabcut_mask(
    image: UInt8[np.ndarray, "H W 3"], regions: MaskRegions, config: MaskConfig
) -> Bool[np.ndarray, "H W"]:
    """Find the hand's mask in an sRGB-encoded image; deterministic."""
    mask = np.zeros(regions.silhouette.shape, bool)
    if not regions.silhouette.any():
        return mask
    crop = _crop(regions.near | regions.forearm)
    found = _cut(image[crop], MaskRegions(*(region[crop] for region in regions)), config)
    mask[crop] = _largest_component((found | regions.core[crop]) & ~regions.forearm[crop])
    return mask


def short_of_arm(vertices: np.ndarray, hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the posed vertices of the hand itself, and its faces among them; a model without an arm stays whole."""
    is_hand = hand.framed_vertices
    index = np.cumsum(is_hand) - 1
    return vertices[is_hand], index[hand.f[is_hand[hand.f].all(1)]]


def _silhouette(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> np.ndarray:
    width, height = camera.size_px
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    fragments = rasterise(positions_px, depth, torch.as_tensor(faces), camera.size_px)
    silhouette = np.zeros(height * width, bool)
    silhouette[fragments.pixel.numpy()] = True
    return silhouette.reshape(height, width)


def _forearm(vertices: np.ndarray, joints: np.ndarray, camera: Camera, length_m: float) -> np.ndarray:
    """Draw the hull of the mesh's end and of a larger copy of it, farther along the forearm."""
    cv2 = load_opencv()
    direction = joints[_WRIST] - joints[_KNUCKLE]
    direction = direction / np.linalg.norm(direction)
    along = vertices @ direction
    end = vertices[along > along.max() - _STUMP * np.ptp(along)]
    flat = end + (along.max() - end @ direction)[:, None] * direction  # pushed to the very end
    copy = flat.mean(0) + _FOREARM_WIDENING * (flat - flat.mean(0)) + length_m * direction
    region = np.zeros(camera.size_px[::-1], np.uint8)
    positions_px, depth = camera.project(np.concatenate([flat, copy]))
    if (depth > NEAR_M).all():
        limit = 8.0 * max(camera.size_px)  # OpenCV counts in 32-bit integers
        hull = cv2.convexHull(positions_px.clip(-limit, limit).round().astype(np.int32))
        cv2.fillConvexPoly(region, hull, 1)
    return region > 0


def _dilated(region: np.ndarray, distance_px: np.ndarray) -> np.ndarray:
    """Dilate the region, or erode it if negative, by a distance in x and y of at least one pixel."""
    cv2 = load_opencv()
    radius = np.maximum(np.abs(distance_px).round(), 1).astype(int)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, tuple((2 * radius + 1).tolist()))
    change = cv2.dilate if distance_px[0] > 0 else cv2.erode
    return change(region.astype(np.uint8), kernel) > 0


def _crop(region: np.ndarray) -> tuple[slice, slice]:
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
    cv2.setRNGSeed(0)  # GrabCut initialises its colour clusters randomly
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(image), labels, None, *models, config.iterations, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def _largest_component(mask: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return mask
    return labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()
