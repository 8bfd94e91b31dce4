"""Which pixels of a view are the right hand's, the left hand's, their forearms', or not known.

The posed meshes say where hands may be, GrabCut seeded by them finds the edge of skin, and the nearest mesh says whose
skin it is. What one hand hides of the other, and forearms, are `UNKNOWN` to that other: neither its skin nor free of
it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter

from ...capture.masks.mask import load_opencv
from ...records.camera import Camera
from ...records.hand_picture import BACKGROUND, HAND, UNKNOWN
from ...records.side import Side
from .outlines import CoveredPixels, covered_pixels
from .rig_hands import RigHands

FREE, RIGHT, LEFT, ARM = 0, 1, 2, 3
"""Labels of a view's pixels, for all hands."""
LABEL_OF: Mapping[Side, int] = {"right": RIGHT, "left": LEFT}
_CORE_MM = 4.0  # inside the mesh: skin
_NEAR_MM, _SKIN_MM = 10.0, 7.0  # outside the mesh: none beyond it; within, skin where it looks so
_JOINED_MM = 9.0  # skin farther from every mesh is somebody else's
_MARGIN_MM = 30.0  # around the hands, that GrabCut sees
_BINS, _BLUR_BINS = 16, 0.7  # of a colour channel
_LEAST_LIKELY = 0.5
_ITERATIONS = 2
_LEAST_PIECE_MM2 = 60.0
_BORDER_MM = 2.0  # at another hand or forearm, whose pixels' colours are mixed


def view_labels(
    rgb: UInt8[np.ndarray, "H W 3"],
    vertices: Float[np.ndarray, "V 3"],
    hands: RigHands,
    camera: Camera,
    px_per_mm: float,
) -> UInt8[np.ndarray, "H W"]:
    """Label all pixels `FREE`, `RIGHT`, `LEFT` or `ARM`.

    Args:
        rgb: the view, sRGB-encoded.
        vertices: of all posed hands, m, world.
        hands: their faces.
        camera: of the view.
        px_per_mm: px in a millimetre at the hands.
    """
    covered = covered_pixels(vertices, hands.faces, camera)
    mesh = mesh_labels(covered, hands)
    if not (mesh > FREE).any():
        return mesh
    box = _box(mesh > FREE, round(_MARGIN_MM * px_per_mm))
    labels = np.zeros_like(mesh)
    labels[box] = _labels_in_box(np.ascontiguousarray(rgb[box]), mesh[box], px_per_mm)
    return labels


def relabelled(labels: UInt8[np.ndarray, "H W"], mesh: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
    """Give skin that was found before to the nearest mesh of a later fit."""
    if not (mesh > FREE).any():
        return labels
    return np.where(labels > FREE, mesh[_nearest(mesh > FREE)], FREE).astype(np.uint8)


def overlap(labels: UInt8[np.ndarray, "H W"], mesh: UInt8[np.ndarray, "H W"], side: Side, arm_px: int = 5) -> float:
    """Compute the intersection over union of a hand's skin and its mesh, away from forearms; NaN for neither."""
    own, counts = LABEL_OF[side], ~np.asarray(binary_dilation((labels == ARM) | (mesh == ARM), iterations=arm_px), bool)
    skin, model = (labels == own) & counts, (mesh == own) & counts
    either = (skin | model).sum()
    return float((skin & model).sum() / either) if either else float("nan")


def mesh_labels(covered: CoveredPixels, hands: RigHands) -> UInt8[np.ndarray, "H W"]:
    """Label the pixels by the nearest mesh alone."""
    count = len(hands.faces) // len(hands.sides)
    of_hand = np.array([LABEL_OF[side] for side in hands.sides])[np.arange(len(hands.faces)) // count]
    of_face = np.append(np.where(hands.arm_faces.numpy(), ARM, of_hand), FREE).astype(np.uint8)  # NONE is the last
    return of_face[covered.face]


def hand_labels(
    labels: UInt8[np.ndarray, "H W"], side: Side, mesh: UInt8[np.ndarray, "H W"], px_per_mm: float
) -> np.ndarray:
    """Convert a view's labels to one hand's `BACKGROUND`, `HAND` and `UNKNOWN`.

    Args:
        labels: of all hands.
        side: of the one.
        mesh: the labels of the meshes alone: what they say is the other's is not known, whether skin was found or not.
        px_per_mm: px in a millimetre at the hands.
    """
    own = LABEL_OF[side]
    other = ((labels > FREE) & (labels != own)) | ((mesh > FREE) & (mesh != own))
    border = binary_dilation(other, iterations=max(1, round(_BORDER_MM * px_per_mm))) if other.any() else other
    result = np.where(labels == own, HAND, BACKGROUND).astype(np.uint8)
    result[border] = UNKNOWN
    return result


def _labels_in_box(rgb: np.ndarray, mesh: np.ndarray, px_per_mm: float) -> np.ndarray:
    cv2 = load_opencv()
    is_mesh = mesh > FREE
    nearest = _nearest(is_mesh)
    outside, inside = (np.asarray(distance_transform_edt(part)) / px_per_mm for part in (~is_mesh, is_mesh))
    core = _core(mesh, inside)
    looks_skin = skin_likelihood(rgb, core, outside > _NEAR_MM) > _LEAST_LIKELY
    seeds = np.full(mesh.shape, cv2.GC_BGD, np.uint8)
    seeds[outside < _NEAR_MM] = cv2.GC_PR_BGD
    seeds[(outside < _SKIN_MM) & looks_skin] = cv2.GC_PR_FGD
    seeds[core & looks_skin] = cv2.GC_FGD
    if not ((seeds == cv2.GC_FGD).any() and np.isin(seeds, (cv2.GC_BGD, cv2.GC_PR_BGD)).any()):
        return mesh
    cv2.setRNGSeed(0)  # GrabCut initialises its colour clusters randomly
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(rgb, seeds, None, *models, _ITERATIONS, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    found = ((seeds == cv2.GC_FGD) | (seeds == cv2.GC_PR_FGD)).astype(np.uint8)
    found = cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(found)
    keeps = stats[:, cv2.CC_STAT_AREA] > _LEAST_PIECE_MM2 * px_per_mm**2
    keeps[0] = False
    return np.where(keeps[pieces] & (outside < _JOINED_MM), mesh[nearest], FREE).astype(np.uint8)


def sure_skin_likelihood(
    rgb: UInt8[np.ndarray, "H W 3"], mesh: UInt8[np.ndarray, "H W"], px_per_mm: float
) -> Float[np.ndarray, "H W"]:
    """Compute `skin_likelihood` with what lies well within the mesh for skin, and what lies well without for none."""
    outside, inside = (np.asarray(distance_transform_edt(part)) / px_per_mm for part in (mesh == FREE, mesh != FREE))
    return skin_likelihood(rgb, _core(mesh, inside), outside > _NEAR_MM)


def _core(mesh: np.ndarray, inside_mm: np.ndarray) -> np.ndarray:
    return (inside_mm > _CORE_MM) & (mesh != ARM)


def skin_likelihood(
    rgb: UInt8[np.ndarray, "H W 3"], skin: Bool[np.ndarray, "H W"], other: Bool[np.ndarray, "H W"]
) -> Float[np.ndarray, "H W"]:
    """Compute how likely each pixel is skin, by this picture's own colours of sure skin and sure background."""
    bins = (rgb.astype(int) * _BINS) >> 8
    index = (bins[..., 0] * _BINS + bins[..., 1]) * _BINS + bins[..., 2]
    shares = []
    for mask in (skin, other):
        count = np.bincount(index[mask], minlength=_BINS**3).astype(float).reshape(_BINS, _BINS, _BINS)
        smooth = gaussian_filter(count, _BLUR_BINS, mode="nearest")
        shares.append(smooth / max(smooth.sum(), 1.0) + 1e-7)
    return (shares[0] / (shares[0] + shares[1])).reshape(-1)[index]


def _nearest(region: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find row and column of the region's pixel nearest to each pixel."""
    row, column = np.asarray(distance_transform_edt(~region, return_distances=False, return_indices=True))
    return row, column


def _box(region: np.ndarray, margin_px: int) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(region.any(axis)) for axis in (1, 0))
    first, last = (slice(max(0, int(at[0]) - margin_px), int(at[-1]) + 1 + margin_px) for at in (rows, columns))
    return first, last
