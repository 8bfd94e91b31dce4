"""The surface of the built-in hand as its captures show it, at two levels of subdivision, with what a pose raises.

The template's faces are chords of a round surface, up to a millimetre below it, and know neither knuckles nor tendons.
The generator knows where the surface is (`tools/builtin_hand/fine_offsets.py` writes the base's file). Vertices follow
the posed template: Loop's subdivision of its vertices, moved by these offsets in their local frames. So sculpted and
retargeted hands have a fine surface, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .base_surface import SURFACE_FILE, base_arrays, has_base
from .raised_skin import PoseForm, RaisedSkin

LEVELS = 2
"""Of subdivision."""
OFFSET_STEP_M, HEIGHT_STEP_MM, VEIN_STEP = 1e-6, 0.025, 0.01
"""What one step of the stored whole numbers is worth."""


@dataclass(frozen=True)
class FineSurface:
    """The surface at rest, N vertices, right hand.

    Attributes:
        offset_m: [N, 3] from Loop's subdivision of the template to the surface, in the template's frame.
        raised: what rises on it.
    """

    offset_m: np.ndarray
    raised: RaisedSkin


def surface_arrays(surface: FineSurface) -> dict[str, np.ndarray]:
    """The arrays of a file, in whole steps."""
    forms, raised = surface.raised.forms, surface.raised
    return {
        "offset": _steps(surface.offset_m, OFFSET_STEP_M, np.int16),
        "vein": _steps(raised.vein, VEIN_STEP, np.int8),
        "flexion": raised.flexion.astype(np.float32),
        "form/joint": np.array([form.joint for form in forms], np.int8),
        "form/range_deg": np.array([(form.start_deg, form.full_deg) for form in forms], np.float32),
        "form/height": _steps(np.stack([form.height_mm for form in forms]), HEIGHT_STEP_MM, np.int8),
    }


def load_fine_surface(hand_sha256: str) -> FineSurface | None:
    """The base surface of a built-in hand; None: this hand has none."""
    return fine_surface_of(base_arrays(SURFACE_FILE)) if has_base(hand_sha256) else None


def fine_surface_of(arrays: Mapping[str, np.ndarray]) -> FineSurface:
    """The surface of a file's arrays (`stored_surface.ARRAYS`)."""
    heights_mm = arrays["form/height"] * np.float32(HEIGHT_STEP_MM)
    forms = [
        PoseForm(int(joint), float(start), float(full), height)
        for joint, (start, full), height in zip(arrays["form/joint"], arrays["form/range_deg"], heights_mm, strict=True)
    ]
    raised = RaisedSkin(tuple(forms), arrays["vein"] * np.float32(VEIN_STEP), arrays["flexion"])
    return FineSurface(arrays["offset"] * np.float32(OFFSET_STEP_M), raised)


def _steps(values: np.ndarray, step: float, kind: type[np.signedinteger]) -> np.ndarray:
    whole, limits = np.round(values / step), np.iinfo(kind)
    if whole.min() < limits.min or whole.max() > limits.max:
        raise ValueError(f"values from {values.min()} to {values.max()} need more steps of {step} than {limits.max}")
    return whole.astype(kind)
