"""HaMeR's and WiLoR's output in `.npz` or plain pickles: absolute rotation matrices in camera axes, a row per hand.

A left hand is estimated from the mirrored crop, as a right hand. Rows have no frame numbers, so each hand's rows are
read as consecutive frames. Their own programs save meshes only: these are the keys that common scripts save the output
under, with or without `pred_mano_params`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...geometry.rotation import matrix_to_axis_angle
from ...hand.model import MIRROR_POINT
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "HaMeR / WiLoR"
_ORTHOGONAL = 0.02
_CROP_PX, _FOCAL_PX = 256, 5000  # of the crop that the networks take as input
_PREFIXES = ("", "pred_mano_params.", "pred_mano_params/", "pred_mano_params_")


def _entry(document: Document, name: str) -> Any:
    nested = document.entries.get("pred_mano_params")
    if isinstance(nested, dict) and name in nested:
        return nested[name]
    return next((document.entries[p + name] for p in _PREFIXES if p + name in document.entries), None)


def _matches(document: Document) -> bool:
    fingers = _entry(document, "hand_pose")
    return isinstance(fingers, np.ndarray) and fingers.shape[-2:] == (3, 3) and fingers.shape[-3:-2] == (15,)


def _read(document: Document) -> PoseFile:
    fingers = _rotations(document, "hand_pose", 15)
    root = _rotations(document, "global_orient", 1)
    count = len(fingers)
    if len(root) != count:
        raise LiveHandError(f"{document.path}: global_orient must have {count} rows, as hand_pose, got {len(root)}")
    betas = _entry(document, "betas")
    beta = np.zeros((count, 10)) if betas is None else document.array(betas, "betas", (count, 10), (count, 1, 10))
    is_right, notes = _is_right(document, count)
    transl, more_notes = _positions(document, count, is_right)
    pose = np.concatenate([root, fingers], 1).reshape(count, 48)
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        rows = np.flatnonzero(is_right == (side == "right"))
        if len(rows):
            betas = beta.reshape(count, 10)[rows]
            position = None if transl is None else transl[rows]
            hands[side] = raw_hand(pose[rows], betas, position, has_right_hand_angles=True)
    return pose_file(document.path, hands, _NAME, "opencv", has_mean_added=True, notes=(*notes, *more_notes))


def _rotations(document: Document, name: str, joints: int) -> np.ndarray:
    """Compute [N, joints, 3] axis-angle of an entry's rotation matrices."""
    value = _entry(document, name)
    if value is None:
        raise LiveHandError(f"{document.path} must hold {name}, as HaMeR's output does, got {list(document.entries)}")
    shapes = ((None, joints, 3, 3), (None, 1, joints, 3, 3), *(((None, 3, 3),) if joints == 1 else ((15, 3, 3),)))
    matrices = document.array(value, name, *shapes).reshape(-1, joints, 3, 3)
    error = np.abs(matrices @ matrices.swapaxes(-1, -2) - np.eye(3)).max(initial=0)
    if error > _ORTHOGONAL or (np.linalg.det(matrices) < 0).any():
        raise LiveHandError(f"{document.path}: {name} must hold rotation matrices, got ones off by {error:.2g}")
    return matrix_to_axis_angle(matrices)


def _is_right(document: Document, count: int) -> tuple[np.ndarray, tuple[str, ...]]:
    value = next((document.entries[key] for key in ("right", "is_right") if key in document.entries), None)
    if value is None:
        return np.ones(count, bool), ("the file does not say which hand it is: a right one is assumed",)
    right = document.array(value, "right", (count,), (count, 1), (), (1,))
    return np.broadcast_to(right.ravel() > 0.5, (count,)), ()


def _positions(document: Document, count: int, is_right: np.ndarray) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Read positions [N, 3] m, the crop's mirroring undone, and notes; None if the file has no positions.

    In the full image's camera if the file has such positions or the boxes of the crops; else in each crop's camera.
    """
    entries = document.entries
    mirror = np.where(is_right[:, None], 1.0, MIRROR_POINT)
    for key in ("pred_cam_t_full", "cam_t_full", "cam_t"):
        if key in entries:
            return document.array(entries[key], key, (count, 3)), ()
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


FORMAT = Format(_NAME, _matches, _read)
