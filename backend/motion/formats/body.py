"""Hands on bodies: AMASS' SMPL-H and SMPL-X `.npz`, SMPL-X' own names, and ARCTIC's `.smplx.npy`.

The wrist's rotation is the product along the chain of body joints from the pelvis to the wrist. The wrist's position is
left out because it needs the body model, and beta because it is the body's shape. Which axis is up is measured: a body
stands, mostly, along its own Y.
"""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from ..spaces import Space
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
_PARTS = {"root_orient": 3, "pose_body": 63, "pose_hand": 90}  # of AMASS' poses, where they are not there as a whole
_BEAT_KEYS = {"expressions", "model"}  # beside AMASS': BEAT2's fingers count from MANO's mean
# The axis along which bodies stand, and whether upwards on it.
_SPACES: dict[tuple[int, bool], Space] = {(2, True): "z_up", (1, True): "y_up", (1, False): "opencv"}
_UPRIGHT = 0.7  # cosine


def _is_amass(document: Document) -> bool:
    poses = document.entries.get("poses")
    if poses is None:
        return document.entries.keys() >= set(_PARTS)
    return isinstance(poses, np.ndarray) and poses.ndim == 2 and poses.shape[1] in _HANDS_IN_POSES


def _read_amass(document: Document) -> PoseFile:
    poses = _amass_poses(document)
    body = poses[:, :66].reshape(-1, 22, 3)
    starts = _HANDS_IN_POSES[poses.shape[1]]
    hands: dict[Side, RawHand] = {}
    for side, start in starts.items():
        hands[side] = _hand(body, side, poses[:, start : start + 45])
    is_beat = document.entries.keys() >= _BEAT_KEYS
    name = "BEAT2 SMPL-X" if is_beat else "AMASS SMPL-H" if poses.shape[1] == 156 else "AMASS SMPL-X"
    space, note = _up(body, "y_up" if is_beat else "z_up")
    return pose_file(
        document.path, hands, name, space, has_mean_added=not is_beat, fps=_fps(document), notes=(*_NOTES, *note)
    )


def _amass_poses(document: Document) -> np.ndarray:
    """Read [T, 156] or [T, 165], whole or from its parts."""
    entries = document.entries
    if "poses" in entries:
        return document.array(entries["poses"], "poses", (None, 156), (None, 165))
    root, body, hands = (document.array(entries[name], name, (None, n)) for name, n in _PARTS.items())
    if len({len(part) for part in (root, body, hands)}) > 1:
        raise LiveHandError(f"{document.path}: {', '.join(_PARTS)} must have equally many frames; download it again")
    return np.concatenate([root, body, hands], 1)


def _up(body: np.ndarray, usual: Space) -> tuple[Space, tuple[str, ...]]:
    """Tell a file's axes from where bodies [T, 22, 3], axis-angle, stand; as usual where they do not."""
    up = axis_angle_to_matrix(body[:, 0])[:, :, 1].mean(0)
    axis = int(np.abs(up).argmax())
    space = _SPACES.get((axis, up[axis] > 0))
    if space is None or abs(up[axis]) < _UPRIGHT:
        return usual, ("which axis is up cannot be told from this body, which does not stand: check the axes",)
    return space, ()


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
    space, note = _up(body, "z_up" if is_arctic else "y_up")
    return pose_file(
        document.path,
        hands,
        "ARCTIC SMPL-X" if is_arctic else "SMPL-X",
        space,
        has_mean_added=not uses_pca,
        uses_pca=uses_pca,
        fps=fps,
        notes=(*_NOTES, *note),
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
