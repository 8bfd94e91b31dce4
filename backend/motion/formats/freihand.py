"""FreiHAND's `training_mano.json`: [N][1][61] of pose, shape and orthographic camera; angles count from MANO's mean."""

from __future__ import annotations

import numpy as np

from ..document import Document
from ..pose_file import PoseFile, pose_file, raw_hand
from .format import Format

_NAME = "FreiHAND"
_NOTES = (
    "the last three numbers are an orthographic camera, not a position: the wrist does not move",
    "the frames are single images, not a motion",
)


def _matches(document: Document) -> bool:
    rows = document.content
    is_nested = isinstance(rows, list) and bool(rows) and isinstance(rows[0], list) and len(rows[0]) == 1
    return is_nested and isinstance(rows[0][0], list) and len(rows[0][0]) == 61


def _read(document: Document) -> PoseFile:
    numbers = document.array(document.content, "its rows", (None, 1, 61))[:, 0]
    raw = raw_hand(np.ascontiguousarray(numbers[:, :48]), numbers[:, 48:58])
    return pose_file(document.path, {"right": raw}, _NAME, "opencv", has_mean_added=False, notes=_NOTES)


FORMAT = Format(_NAME, _matches, _read)
