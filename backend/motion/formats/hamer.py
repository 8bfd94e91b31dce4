"""HaMeR's, WiLoR's and WiLoR-mini's output in `.npz` or plain pickles: absolute rotations in camera axes, row by row.

A left hand is estimated from the mirrored crop, as a right hand. HaMeR and WiLoR leave it so and give matrices;
WiLoR-mini gives axis-angles and has mirrored them back. Other programs do either, so the fingers' bend decides where
it can. Their own programs save meshes only: these are the keys that common scripts save the output under, with or
without `pred_mano_params`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...geometry.rotation import matrix_to_axis_angle
from ...hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document, shape_of
from ..gate import bends_backwards
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "HaMeR / WiLoR"
_ORTHOGONAL = 0.02
_CROP_PX, _FOCAL_PX = 256, 5000  # of the crop that the networks take as input
_PREFIXES = ("", "pred_mano_params.", "pred_mano_params/", "pred_mano_params_")
_SIDE_KEYS, _FRAME_KEYS = ("right", "is_right"), ("frame", "frames", "frame_id", "frame_idx", "frame_number")
_OWN_KEYS = (*_SIDE_KEYS, "pred_cam", "pred_cam_t", "pred_cam_t_full")


class _Rows(NamedTuple):
    """N hands of a file: pose [N, 16, 3] rad, beta [N, 10], whether a right one [N], its frame [N]."""

    pose: np.ndarray
    beta: np.ndarray
    is_right: np.ndarray
    frames: np.ndarray
    notes: tuple[str, ...]


def _entry(document: Document, name: str) -> Any:
    nested = document.entries.get("pred_mano_params")
    if isinstance(nested, dict) and name in nested:
        return nested[name]
    return next((document.entries[p + name] for p in _PREFIXES if p + name in document.entries), None)


def _matches(document: Document) -> bool:
    entries, fingers = document.entries, _entry(document, "hand_pose")
    if fingers is None or "body_pose" in entries:
        return False
    is_angles = shape_of(fingers)[-2:] == (15, 3) or shape_of(fingers)[1:] == (45,)
    return _is_matrices(fingers, 15) or (is_angles and any(key in entries for key in _OWN_KEYS))


def read_rows(document: Document, first: int | None = None) -> PoseFile:
    """Read the rows of a document, each a hand in a frame; the file's first has this number, None: the smallest.

    Raises:
        LiveHandError: it is malformed.
    """
    rows = _rows(document, first)
    is_mirrored, notes = _is_left_mirrored(document, rows)
    transl, more_notes = _positions(document, rows, is_mirrored)
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        of_side = np.flatnonzero(rows.is_right == (side == "right"))
        if len(of_side):
            of_side = of_side[np.unique(rows.frames[of_side], return_index=True)[1]]
            hands[side] = raw_hand(
                rows.pose[of_side].reshape(-1, 48),
                rows.beta[of_side],
                None if transl is None else transl[of_side],
                rows.frames[of_side],
                angles_side="right" if side == "right" or is_mirrored else "left",
            )
    notes = (*rows.notes, *notes, *more_notes)
    is_guessed = not any(key in document.entries for key in _SIDE_KEYS)
    return pose_file(
        document.path, hands, _NAME, "opencv", has_mean_added=True, notes=notes, is_side_guessed=is_guessed
    )


def _rows(document: Document, first: int | None) -> _Rows:
    fingers, root = _rotations(document, "hand_pose", 15), _rotations(document, "global_orient", 1)
    count = len(fingers)
    if len(root) != count:
        raise LiveHandError(f"{document.path}: global_orient must have {count} rows, as hand_pose, got {len(root)}")
    betas = _entry(document, "betas")
    beta = np.zeros((count, 10)) if betas is None else document.array(betas, "betas", (count, 10), (count, 1, 10))
    pose = np.concatenate([root, fingers], 1)
    is_right, notes = _is_right(document, pose)
    frames, is_counted = _frames(document, is_right, first)
    if is_counted and 0 < is_right.sum() < count:
        notes = (*notes, "the rows have no frame numbers: each hand's are taken for consecutive frames")
    return _Rows(pose, beta.reshape(count, 10), is_right, frames, notes)


def _rotations(document: Document, name: str, joints: int) -> np.ndarray:
    """Compute [N, joints, 3] axis-angle of an entry's rotation matrices, or read its axis-angles."""
    value = _entry(document, name)
    if value is None:
        raise LiveHandError(f"{document.path} must hold {name}, as HaMeR's output does, got {document.keys_in_words}")
    if _is_matrices(value, joints):
        one = ((None, 3, 3),) if joints == 1 else ((15, 3, 3),)
        shapes = ((None, joints, 3, 3), (None, 1, joints, 3, 3), *one)
        matrices = document.array(value, name, *shapes).reshape(-1, joints, 3, 3)
        error = np.abs(matrices @ matrices.swapaxes(-1, -2) - np.eye(3)).max(initial=0)
        if error > _ORTHOGONAL or (np.linalg.det(matrices) < 0).any():
            raise LiveHandError(f"{document.path}: {name} must hold rotation matrices, got ones off by {error:.2g}")
        return matrix_to_axis_angle(matrices)
    shapes = ((None, joints, 3), (None, 1, joints, 3), (None, 3 * joints), (None, 1, 3 * joints))
    return document.array(value, name, *shapes, (joints, 3)).reshape(-1, joints, 3)


def _is_matrices(value: Any, joints: int) -> bool:
    shape = shape_of(value)
    return shape[-3:] == (joints, 3, 3) or (joints == 1 and len(shape) > 2 and shape[-2:] == (3, 3))


def _is_right(document: Document, pose: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    value, count = next((document.entries[key] for key in _SIDE_KEYS if key in document.entries), None), len(pose)
    if value is None:
        is_right = not bends_backwards(pose, "right")
        reason = "a right one is assumed" if is_right else "its fingers bend like a left one's"
        return np.full(count, is_right), (f"the file does not say which hand it is: {reason}",)
    right = document.array(value, "right", (count,), (count, 1), (), (1,))
    return np.broadcast_to(right.ravel() > 0.5, (count,)), ()


def _frames(document: Document, is_right: np.ndarray, first: int | None) -> tuple[np.ndarray, bool]:
    """Find the frame of each row from the file's first on, and whether it was only counted, each hand by itself."""
    value = next((document.entries[key] for key in _FRAME_KEYS if key in document.entries), ())
    if not 0 < np.size(value) == len(is_right) or np.asarray(value).dtype.kind not in "iuf":
        return np.where(is_right, np.cumsum(is_right), np.cumsum(~is_right)) - 1, True
    numbers = document.array(value, "frames").ravel().round().astype(int)
    return numbers - (numbers.min() if first is None else first), False


def _is_left_mirrored(document: Document, rows: _Rows) -> tuple[bool, tuple[str, ...]]:
    """Tell whether the left hands are right ones of mirrored crops: as the layout says, unless they bend backwards."""
    is_mirrored, left = _is_matrices(_entry(document, "hand_pose"), 15), rows.pose[~rows.is_right]
    if not len(left) or not bends_backwards(left * (MIRROR_AXIS_ANGLE if is_mirrored else 1), "left"):
        return is_mirrored, ()
    how = "mirrored back already" if is_mirrored else "those of a mirrored right one"
    return not is_mirrored, (f"the left hand's angles are {how}, as its fingers bend",)


def _positions(document: Document, rows: _Rows, is_mirrored: bool) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Read positions [N, 3] m, a left hand's mirroring undone, and notes; None if the file has no positions.

    In the full image's camera if the file has such positions or the boxes of the crops; else in each crop's camera.
    """
    entries, count = document.entries, len(rows.pose)
    mirror = np.where(rows.is_right[:, None] | (not is_mirrored), 1.0, MIRROR_POINT)
    for key in ("pred_cam_t_full", "cam_t_full", "cam_t"):
        if key in entries:
            return document.array(entries[key], key, (count, 3), (count, 1, 3)).reshape(count, 3), ()
    boxes = [key for key in ("pred_cam", "box_center", "box_size", "img_size") if key in entries]
    if len(boxes) == 4:
        camera = document.array(entries["pred_cam"], "pred_cam", (count, 3)) * mirror[:, [1, 0, 2]]
        return _in_full_camera(document, camera, count), ()
    if "pred_cam_t" in entries:
        note = "positions are in each crop's own camera, so the path is wrong (no box_center, box_size, img_size)"
        return document.array(entries["pred_cam_t"], "pred_cam_t", (count, 3)) * mirror, (note,)
    return None, ("the file has no positions: the wrist does not move",)


def _in_full_camera(document: Document, camera: np.ndarray, count: int) -> np.ndarray:
    """Return [N, 3] m from the crops' weak-perspective cameras (scale, x, y) [N, 3]."""
    entries = document.entries
    centre = document.array(entries["box_center"], "box_center", (count, 2))
    size_px = document.array(entries["box_size"], "box_size", (count,), (count, 1)).reshape(count)
    image_px = np.broadcast_to(document.array(entries["img_size"], "img_size", (2,), (count, 2)), (count, 2))
    scale = size_px * camera[:, 0]
    if (scale <= 0).any():
        raise LiveHandError(f"{document.path}: box_size and pred_cam's scale must be positive; track the hand again")
    focal_px = _FOCAL_PX / _CROP_PX * image_px.max(1)
    across = 2 * (centre - image_px / 2) / scale[:, None] + camera[:, 1:]
    return np.concatenate([across, (2 * focal_px / scale)[:, None]], 1)


FORMAT = Format(_NAME, _matches, read_rows)
