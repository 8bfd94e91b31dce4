"""Plain arrays: [T, 48] pose, [T, 51] pose and transl, [T, 61] pose, shape and transl, in any file type.

They do not say whether MANO's mean pose is in the angles, which hand it is, or which axes are used.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...records.side import Side
from ..document import Document
from ..pose_file import PoseFile, pose_file, raw_hand
from .format import Format

_NAME = "Raw MANO"
_POSES = ("poses", "pose", "mano_poses", "mano_pose", "mano_params", "params", "arr_0")
_BETAS, _TRANSLS = ("betas", "beta", "shape", "shapes"), ("trans", "transl", "translation")
_WIDTHS = (48, 51, 61)
_NOTES = ("the file does not say whether MANO's mean is in the angles, nor its axes: check them",)


def _entry(document: Document, names: tuple[str, ...]) -> Any:
    return next((document.entries[name] for name in names if name in document.entries), None)


def _poses(document: Document) -> Any:
    return document.content if isinstance(document.content, list | np.ndarray) else _entry(document, _POSES)


def _matches(document: Document) -> bool:
    poses = _poses(document)
    try:
        shape = np.shape(poses)
    except ValueError:  # rows of different lengths
        return False
    return shape[-1:] in {(n,) for n in _WIDTHS} or shape[-2:] == (16, 3)


def _read(document: Document) -> PoseFile:
    poses = np.asarray(_poses(document))
    if poses.shape[-2:] == (16, 3):
        poses = poses.reshape(*poses.shape[:-2], 48)
    shapes = [shape for width in _WIDTHS for shape in ((None, width), (width,), (None, 1, width))]
    numbers = document.array(poses, "poses", *shapes).reshape(-1, poses.shape[-1])
    count, width = numbers.shape
    beta, transl = _entry(document, _BETAS), _entry(document, _TRANSLS)
    raw = raw_hand(
        numbers[:, :48],
        numbers[:, 48:58] if width == 61 else _optional_array(document, beta, "betas", (None,), (count, None)),
        numbers[:, -3:] if width > 48 else _optional_array(document, transl, "trans", (count, 3)),
    )
    fps = _optional_array(document, document.entries.get("fps"), "fps", (), (1,))
    return pose_file(
        document.path,
        {_side(document): raw},
        _NAME,
        "hand",
        has_mean_added=True,
        fps=None if fps is None else fps.item(),
        notes=_NOTES,
    )


def _optional_array(document: Document, value: Any, name: str, *shapes: tuple[int | None, ...]) -> np.ndarray | None:
    return None if value is None else document.array(value, name, *shapes)


def _side(document: Document) -> Side:
    """Find the side in the file, else in its name, else right."""
    text = str(document.entries.get("side", document.path.stem)).lower()
    return "left" if "left" in text else "right"


FORMAT = Format(_NAME, _matches, _read)
