"""HOT3D's `mano_hand_pose_trajectory.jsonl`, and its clips' `*.hands.json`, one frame each: components from the mean.

Hand 0 is the left one. A line holds the time and the hands that are there, each with `pose`, `betas` and `wrist_xform`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...geometry.rotation import quaternion_to_axis_angle
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..motion import MOST_FRAMES
from ..pose_file import NoHandError, PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "HOT3D"
_KEYS: dict[Side, str] = {"right": "1", "left": "0"}
_FPS = 30.0
_NS = 1e-9
_NOTES = ("its world's up axis is taken for Z: check the axes",)


def _matches(document: Document) -> bool:
    content = document.content
    if isinstance(content, list):
        return any(isinstance(line, Mapping) and isinstance(line.get("hand_poses"), Mapping) for line in content[:1])
    return any(isinstance(hand, Mapping) and "mano_pose" in hand for hand in map(document.entries.get, SIDES))


def _read(document: Document) -> PoseFile:
    lines = document.content if isinstance(document.content, list) else [document.content]
    frames, fps = _frames(document, lines)
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        found = [(frame, row) for frame, line in zip(frames, lines, strict=True) for row in _rows(document, line, side)]
        if found:
            indices, first = np.unique([frame for frame, _ in found], return_index=True)
            rows = np.array([found[index][1] for index in first])
            hands[side] = raw_hand(rows[:, :18], rows[:, 21:], rows[:, 18:21], indices)
    if not hands:
        raise NoHandError(f"{document.path} must hold a hand's pose, got none (the test split has none)")
    return pose_file(document.path, hands, _NAME, "z_up", has_mean_added=False, uses_pca=True, fps=fps, notes=_NOTES)


def _frames(document: Document, lines: list[Any]) -> tuple[list[int], float]:
    """Find the frame of each line, from 0, by its time, and the rate."""
    times = [line.get("timestamp_ns") for line in lines if isinstance(line, Mapping)]
    if len(times) < 2 or len(times) < len(lines) or any(time is None for time in times):
        return list(range(len(lines))), _FPS
    seconds = document.array(times, "timestamp_ns", (len(lines),)) * _NS
    step = float(np.median(np.diff(seconds)))
    if step <= 0 or (np.diff(seconds) < 0).any() or (seconds[-1] - seconds[0]) / step > MOST_FRAMES:
        raise LiveHandError(f"{document.path}: timestamp_ns must increase from line to line; download the file again")
    return ((seconds - seconds[0]) / step).round().astype(int).tolist(), round(1 / step, 3)


def _rows(document: Document, line: Any, side: Side) -> Iterator[np.ndarray]:
    """Yield the wrist, 15 components, place and shape [31] of the hand, if the line has it."""
    poses = line.get("hand_poses") if isinstance(line, Mapping) else None
    if isinstance(poses, Mapping) and isinstance(hand := poses.get(_KEYS[side]), Mapping):
        if "pose" not in hand or not isinstance(hand.get("wrist_xform"), Mapping):
            raise LiveHandError(
                f"{document.path} must hold MANO's pose and wrist_xform, got {sorted(hand)[:6]}: UmeTrack's joint "
                "angles are of another hand; give mano_hand_pose_trajectory.jsonl, which lies beside it"
            )
        quaternion = document.array(hand["wrist_xform"].get("q_wxyz"), "q_wxyz", (4,))
        if np.linalg.norm(quaternion) == 0:
            raise LiveHandError(f"{document.path}: q_wxyz must be a rotation, got zeros; download the file again")
        root = quaternion_to_axis_angle(quaternion / np.linalg.norm(quaternion))
        place = document.array(hand["wrist_xform"].get("t_xyz"), "t_xyz", (3,))
        yield _row(document, hand, hand["pose"], np.r_[root, place])
    elif isinstance(line, Mapping) and isinstance(hand := line.get(side), Mapping) and "mano_pose" in hand:
        pose = hand["mano_pose"]
        if not isinstance(pose, Mapping):
            raise LiveHandError(f"{document.path}: mano_pose must hold thetas and wrist_xform; download the file again")
        yield _row(document, hand, pose.get("thetas"), document.array(pose.get("wrist_xform"), "wrist_xform", (6,)))


def _row(document: Document, hand: Mapping[str, Any], pose: Any, wrist: np.ndarray) -> np.ndarray:
    beta = document.array(hand.get("betas", np.zeros(10)), "betas", (10,))
    return np.r_[wrist[:3], document.array(pose, "pose", (15,)), wrist[3:], beta]


FORMAT = Format(_NAME, _matches, _read)
