"""The surface of the built-in hand as its captures show it, at two levels of subdivision, with what a pose raises.

The template's faces are chords of a round surface, up to a millimetre below it, and know neither knuckles nor tendons.
The generator knows where the surface is (`builtin/fine_offsets.py` writes the file). Vertices follow the posed
template: Loop's subdivision of its vertices, moved by these offsets in their local frames. So sculpted and retargeted
hands have a fine surface, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..hand.model_file import DEFAULT_HAND, builtin_hand_path, builtin_sha256
from .raised_skin import PoseForm, RaisedSkin

LEVELS = 2
"""Of subdivision."""
OFFSET_STEP_M, HEIGHT_STEP_MM, VEIN_STEP = 1e-6, 0.025, 0.01
"""What one step of the stored whole numbers is worth."""
FILE = f"surface_of_{DEFAULT_HAND}.npz"
"""Beside the hand's own."""


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
    """The arrays of the file."""
    forms, raised = surface.raised.forms, surface.raised
    return {
        "offset": _steps(surface.offset_m, OFFSET_STEP_M, np.int16),
        "vein": _steps(raised.vein, VEIN_STEP, np.int8),
        "flexion": raised.flexion.astype(np.float32),
        "joint": np.array([form.joint for form in forms], np.int8),
        "range_deg": np.array([(form.start_deg, form.full_deg) for form in forms], np.float32),
        "height": _steps(np.stack([form.height_mm for form in forms]), HEIGHT_STEP_MM, np.int8),
    }


def load_fine_surface(hand_sha256: str) -> FineSurface | None:
    """The surface of a built-in hand; None: this hand has none."""
    if hand_sha256 != builtin_sha256():
        return None
    with np.load(builtin_hand_path().with_name(FILE), allow_pickle=False) as file:
        arrays = dict(file)
    heights_mm = arrays["height"] * np.float32(HEIGHT_STEP_MM)
    forms = [
        PoseForm(int(joint), float(start), float(full), height)
        for joint, (start, full), height in zip(arrays["joint"], arrays["range_deg"], heights_mm, strict=True)
    ]
    raised = RaisedSkin(tuple(forms), arrays["vein"] * np.float32(VEIN_STEP), arrays["flexion"])
    return FineSurface(arrays["offset"] * np.float32(OFFSET_STEP_M), raised)


def _steps(values: np.ndarray, step: float, kind: type[np.signedinteger]) -> np.ndarray:
    whole, limits = np.round(values / step), np.iinfo(kind)
    if whole.min() < limits.min or whole.max() > limits.max:
        raise ValueError(f"values from {values.min()} to {values.max()} need more steps of {step} than {limits.max}")
    return whole.astype(kind)
