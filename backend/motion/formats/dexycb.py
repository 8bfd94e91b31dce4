"""DexYCB's `labels_*.npz`, one frame per file: 45 coefficients of MANO's components, in the camera's axes."""

from __future__ import annotations

import numpy as np

from ..document import Document
from ..pose_file import NoHandError, PoseFile, pose_file, raw_hand
from .format import Format

_NAME = "DexYCB"
_FPS = 30.0
_NOTES = (
    "the side is in the sequence's meta.yml and the shape in its mano.yml: a right hand of mean shape is assumed",
    "DexYCB's left hands were fitted with MANO's left shapes un-mirrored",
)


def _matches(document: Document) -> bool:
    return "pose_m" in document.entries


def _read(document: Document) -> PoseFile:
    numbers = document.array(document.entries["pose_m"], "pose_m", (None, 51))
    indices = np.flatnonzero(numbers.any(1))
    if len(indices) == 0:
        raise NoHandError(f"{document.path} must hold a hand, got a frame without one (all zero)")
    raw = raw_hand(numbers[indices, :48], transl=numbers[indices, 48:], frame_indices=indices)
    return pose_file(
        document.path, {"right": raw}, _NAME, "opencv", has_mean_added=False, uses_pca=True, fps=_FPS, notes=_NOTES
    )


FORMAT = Format(_NAME, _matches, _read)
