"""Hands on bodies: AMASS' SMPL-H and SMPL-X `.npz`, SMPL-X' own names, and ARCTIC's `.smplx.npy`.

The wrist's rotation is the product along the chain of body joints from the pelvis to the wrist. The wrist's position is
left out because it needs the body model, and beta because it is the body's shape.
"""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

# SMPL's joints from the pelvis to each wrist.
_CHAINS: dict[Side, tuple[int, ...]] = {"right": (0, 3, 6, 9, 14, 17, 19, 21), "left": (0, 3, 6, 9, 13, 16, 18, 20)}
_NOTES = (
    "the wrist's rotation is that of the body's chain; its position needs the body model and is left out",
    "the shape in the file is the body's and is left out",
)
# Where each hand's 45 numbers begin in a pose vector, by the vector's length.
_HANDS_IN_POSES: dict[int, dict[Side, int]] = {156: {"left": 66, "right": 111}, 165: {"left": 75, "right": 120}}
_FPS = ("mocap_framerate", "mocap_frame_rate", "fps")


def _is_amass(document: Document) -> bool:
    poses = document.entries.get("poses")
    return isinstance(poses, np.ndarray) and poses.ndim == 2 and poses.shape[1] in _HANDS_IN_POSES


def _read_amass(document: Document) -> PoseFile:
    poses = document.array(document.entries["poses"], "poses", (None, 156), (None, 165))
    body = poses[:, :66].reshape(-1, 22, 3)
    starts = _HANDS_IN_POSES[poses.shape[1]]
    hands: dict[Side, RawHand] = {}
    for side, start in starts.items():
        hands[side] = _hand(body, side, poses[:, start : start + 45])
    name = "AMASS SMPL-H" if poses.shape[1] == 156 else "AMASS SMPL-X"
    return pose_file(document.path, hands, name, "z_up", has_mean_added=True, fps=_fps(document), notes=_NOTES)


def _is_smplx(document: Document) -> bool:
    entries = document.entries
    return "body_pose" in entries and bool({"left_hand_pose", "right_hand_pose"} & entries.keys())


def _read_smplx(document: Document) -> PoseFile:
    entries = document.entries
    if "global_orient" not in entries:
        raise LiveHandError(
            f"{document.path} must hold global_orient, the body's own rotation, got {sorted(entries)[:12]}"
        )
    root = document.array(entries["global_orient"], "global_orient", (None, 3), (3,), (None, 1, 3)).reshape(-1, 1, 3)
    count = len(root)
    rest = document.array(entries["body_pose"], "body_pose", (count, 63), (count, 21, 3), (63,))
    body = np.concatenate([root, rest.reshape(count, 21, 3)], 1)
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        key = f"{side}_hand_pose"
        if key in entries:
            fingers = document.array(entries[key], key, (count, None), (count, 15, 3)).reshape(count, -1)
            hands[side] = _hand(body, side, fingers)
    is_arctic = document.path.name.endswith(".smplx.npy")
    uses_pca = any(raw.fingers.shape[1] != 45 for raw in hands.values())
    fps = 30.0 if is_arctic else _fps(document)
    name, space = ("ARCTIC SMPL-X", "z_up") if is_arctic else ("SMPL-X", "y_up")
    notes = (*_NOTES, "the format does not say which axis is up: check the axes")
    return pose_file(
        document.path, hands, name, space, has_mean_added=not uses_pca, uses_pca=uses_pca, fps=fps, notes=notes
    )


def _hand(body: np.ndarray, side: Side, fingers: np.ndarray) -> RawHand:
    """Read a hand on a body with joints [T, 22, 3], axis-angle."""
    rotation = np.eye(3)
    for joint in _CHAINS[side]:
        rotation = rotation @ axis_angle_to_matrix(body[:, joint])
    return raw_hand(np.concatenate([matrix_to_axis_angle(rotation), fingers], 1))


def _fps(document: Document) -> float | None:
    key = next((key for key in _FPS if key in document.entries), None)
    return None if key is None else document.array(document.entries[key], key, (), (1,)).item()


AMASS = Format("AMASS", _is_amass, _read_amass)
SMPLX = Format("SMPL-X", _is_smplx, _read_smplx)
