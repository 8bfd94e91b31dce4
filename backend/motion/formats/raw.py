"""Plain arrays: [T, 48] pose, [T, 51] pose and transl, [T, 61] pose, shape and transl, in any file type.

They do not say whether MANO's mean pose is in the angles, which hand it is, which axes are used, or whether angles are
in degrees. The fingers' bend tells the hand, and their size the degrees.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...records.side import Side
from ..document import Document, shape_of
from ..gate import bends_backwards
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
    shape = shape_of(_poses(document))
    return shape[-1:] in {(n,) for n in _WIDTHS} or shape[-2:] == (16, 3)


def _read(document: Document) -> PoseFile:
    poses = np.asarray(_poses(document))
    if poses.shape[-2:] == (16, 3):
        poses = poses.reshape(*poses.shape[:-2], 48)
    shapes = [shape for width in _WIDTHS for shape in ((None, width), (width,), (None, 1, width))]
    numbers = document.array(poses, "poses", *shapes).reshape(-1, poses.shape[-1])
    count, width = numbers.shape
    beta, transl = _entry(document, _BETAS), _entry(document, _TRANSLS)
    pose, notes = _in_radians(numbers[:, :48])
    side, angles_side, side_note = _sides(document, pose)
    raw = raw_hand(
        pose,
        numbers[:, 48:58] if width == 61 else _optional_array(document, beta, "betas", (None,), (count, None)),
        numbers[:, -3:] if width > 48 else _optional_array(document, transl, "trans", (count, 3)),
        angles_side=angles_side,
    )
    fps = _optional_array(document, document.entries.get("fps"), "fps", (), (1,))
    return pose_file(
        document.path,
        {side: raw},
        _NAME,
        "hand",
        has_mean_added=True,
        fps=None if fps is None else fps.item(),
        notes=(*_NOTES, *notes, *side_note),
        is_side_guessed=_named_side(document) is None,
    )


def _optional_array(document: Document, value: Any, name: str, *shapes: tuple[int | None, ...]) -> np.ndarray | None:
    return None if value is None else document.array(value, name, *shapes)


def _in_radians(pose: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Convert angles [N, 48] that are larger than a full turn from degrees, and note it."""
    if np.linalg.norm(pose[:, 3:].reshape(-1, 3), axis=-1).max(initial=0) <= 2 * np.pi:
        return pose, ()
    return np.deg2rad(pose), ("the angles are larger than a full turn in radians: read as degrees",)


def _sides(document: Document, pose: np.ndarray) -> tuple[Side, Side | None, tuple[str, ...]]:
    """Find which hand pose [N, 48] is of, by its name or its fingers' bend, whose angles if not its own, and notes."""
    named = _named_side(document)
    side = named or "right"
    other: Side = "left" if side == "right" else "right"
    if not len(pose) or not bends_backwards(pose.reshape(-1, 16, 3), side):
        return side, None, ()
    if named is None:
        return other, None, (f"the file does not say which hand it is: its fingers bend like a {other} one's",)
    return side, other, (f"named '{named}', but its fingers bend as mirrored ones do: they are mirrored back",)


def _named_side(document: Document) -> Side | None:
    """Find the side in the file, else in its name."""
    text = str(document.entries.get("side", document.path.stem)).lower()
    return "left" if "left" in text else "right" if "right" in text else None


FORMAT = Format(_NAME, _matches, _read)
