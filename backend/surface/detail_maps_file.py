"""The fine detail of the built-in hand's skin: folds, fine lines, ridges, rims of nails, as maps over the atlas.

An avatar learns from pictures what its planes resolve, some 0.7 mm, and shows of it what the rays of a frame resolve.
These maps hold what is finer, as the generator of the skin made it (`tools/builtin_hand/detail_maps.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .base_surface import COARSE_FILE, FINE_FILE, SURFACE_FILE, base_arrays, has_base

ATLAS_MM = 270.0
"""Side of the atlas on the skin."""
COARSEST_MM, WIDEST_MM = 0.8, 6.0
"""Deviations of the blurs that were subtracted from the fine and from the coarse maps."""
RELIEF_STEP_MM, FOLD_STEP, PIGMENT_STEP, NAIL_STEP, ROUGHNESS_STEP, SLOPE_STEP = 0.002, 0.01, 0.01, 0.01, 0.005, 0.01
"""What one step of the stored whole numbers is worth."""
FULL_FLEX_RAD = float(np.deg2rad(65))
"""What counts as a bend of 1."""
FLATTENED, DEEPENED_FROM, DEEPENED_BY = 0.72, 0.75, 0.5
"""What bending a joint by 1 takes from the folds on its back, and what it makes of the creases below."""
# Skin far from any joint moves with a share of the mean bend of the four knuckles.
_KNUCKLES, _PALM_SHARE, _MOST_FLEX = (1, 4, 7, 10), 0.6, 1.3


@dataclass(frozen=True)
class SkinFlexion:
    """How a pose bends the skin.

    Attributes:
        joint: [V] whose bend stretches the skin at each vertex; 0: that of the palm.
        flexion: [16, 3] unit axes about which joints bend, right hand, template frame.
    """

    joint: np.ndarray
    flexion: np.ndarray

    def flex(self, theta: np.ndarray) -> np.ndarray:
        """Compute the bend of the skin [V], 1 at `FULL_FLEX_RAD`, in a pose [16, 3] of the right hand, rad."""
        bend = np.clip((theta * self.flexion).sum(1) / FULL_FLEX_RAD, 0, _MOST_FLEX)
        return np.where(self.joint > 0, bend[self.joint], bend[list(_KNUCKLES)].mean() * _PALM_SHARE)


@dataclass(frozen=True)
class SkinMaps:
    """Maps [N, N] over the atlas, the row of the smallest v first.

    Attributes:
        relief_mm: height of lines, ridges and rims.
        dorsal: depth of the folds on the back of joints, 1 at the deepest.
        palmar: depth of the creases of the palm and below the fingers.
        pigment_light, pigment_deep: logarithm of the albedo of a light and of a deep skin.
    """

    relief_mm: np.ndarray
    dorsal: np.ndarray
    palmar: np.ndarray
    pigment_light: np.ndarray
    pigment_deep: np.ndarray


@dataclass(frozen=True)
class SurfaceDetail:
    """The skin's detail by its size.

    Attributes:
        fine: without all that is coarser than `COARSEST_MM`.
        coarse: what lies between that and `WIDEST_MM`.
        nail: [N / 4, N / 4] 1 on nails, 0 on skin.
        roughness: [N / 4, N / 4] of the skin's gloss; Blender's, the square root of the microfacets' alpha.
        unresolved: [2, N / 2, N / 2] slopes along u and v that the detail surface's normals lack, m a m
            (`builtin/unresolved_slopes.py`).
        bend: which folds follow.
    """

    fine: SkinMaps
    coarse: SkinMaps
    nail: np.ndarray
    roughness: np.ndarray
    unresolved: np.ndarray
    bend: SkinFlexion


def load_surface_detail(hand_sha256: str) -> SurfaceDetail | None:
    """Load the detail maps of the base surface of a built-in hand; None: this hand has none."""
    arrays = base_arrays(SURFACE_FILE, FINE_FILE, COARSE_FILE) if has_base(hand_sha256) else None
    return None if arrays is None else skin_detail_of(arrays)


def skin_detail_of(arrays: Mapping[str, np.ndarray]) -> SurfaceDetail:
    """Build the detail maps of a surface's arrays (`stored_surface.ARRAYS`)."""
    return SurfaceDetail(
        fine=_maps(arrays, "fine"),
        coarse=_maps(arrays, "coarse"),
        nail=arrays["nail"] * np.float32(NAIL_STEP),
        roughness=arrays["roughness"] * np.float32(ROUGHNESS_STEP),
        unresolved=arrays["unresolved"] * np.float32(SLOPE_STEP),
        bend=SkinFlexion(arrays["bend/joint"].astype(int), arrays["flexion"]),
    )


def _maps(steps: Mapping[str, np.ndarray], level: str) -> SkinMaps:
    return SkinMaps(
        relief_mm=steps[f"{level}/relief"] * np.float32(RELIEF_STEP_MM),
        dorsal=steps[f"{level}/dorsal"] * np.float32(FOLD_STEP),
        palmar=steps[f"{level}/palmar"] * np.float32(FOLD_STEP),
        pigment_light=steps[f"{level}/pigment_light"] * np.float32(PIGMENT_STEP),
        pigment_deep=steps[f"{level}/pigment_deep"] * np.float32(PIGMENT_STEP),
    )
