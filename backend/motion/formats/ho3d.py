"""HO-3D's `meta/*.pkl`, one frame per file, or a `.npz` with the same keys: absolute angles in OpenGL's camera axes."""

from __future__ import annotations

from ..document import Document
from ..pose_file import NoHandError, PoseFile, pose_file, raw_hand
from .format import Format

_NAME = "HO-3D"
_FPS = 30.0
_NAMES = ("handPose", "handTrans", "handBeta")


def _matches(document: Document) -> bool:
    return "handPose" in document.entries or {"handJoints3D", "camMat"} <= document.entries.keys()


def _read(document: Document) -> PoseFile:
    entries = document.entries
    if entries.get("handPose") is None:
        raise NoHandError(
            f"{document.path} must hold handPose, got a frame without one (the evaluation split has none)"
        )
    pose, transl, beta = (entries.get(name) for name in _NAMES)
    angles = document.array(pose, "handPose", (48,), (None, 48)).reshape(-1, 48)
    count = len(angles)
    raw = raw_hand(
        angles,
        None if beta is None else document.array(beta, "handBeta", (10,), (count, 10)),
        None if transl is None else document.array(transl, "handTrans", (3,), (count, 3)).reshape(count, 3),
    )
    return pose_file(document.path, {"right": raw}, _NAME, "opengl", has_mean_added=True, fps=_FPS)


FORMAT = Format(_NAME, _matches, _read)
