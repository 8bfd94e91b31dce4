"""The provenance of a frame, stored as JSON beside it."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from ..records.camera import Camera
from ..records.shot import HandPose


@dataclass(frozen=True)
class HandRecord:
    """One hand of a frame, as it was rendered.

    Attributes:
        pose: its parameters.
        avatar_name: the name in the avatar's file.
        avatar_path: the avatar's file.
        hand_sha256: of the hand model's file.
    """

    pose: HandPose
    avatar_name: str
    avatar_path: Path
    hand_sha256: str


def frame_record(
    shot: Path, frame: int, size_px: tuple[int, int], camera: Camera, hands: Sequence[HandRecord]
) -> dict[str, Any]:
    """The provenance of a frame as a JSON object.

    Args:
        shot: the .blend.
        frame: its number.
        size_px: (width, height) of the frame's file.
        camera: of the rendered region, which is the whole image unless the scene has a render border.
        hands: all hands in the frame.
    """
    return {
        "livehand": livehand_version(),
        "shot": str(shot.resolve()),
        "frame": frame,
        "size_px": list(size_px),
        "camera": {
            "K": camera.K.tolist(),
            "cam2world": camera.cam2world.tolist(),
            "size_px": list(camera.size_px),
        },
        "hands": [_hand_record(hand) for hand in hands],
    }


def save_record(record: dict[str, Any], path: Path) -> None:
    """Write the record as one line; raises OSError."""
    path.write_text(json.dumps(record) + "\n", encoding="utf-8")


@cache
def livehand_version() -> str:
    """The version in the manifest."""
    root = str(__package__).removesuffix(".backend.batch")
    manifest = resources.files(root).joinpath("blender_manifest.toml").read_text(encoding="utf-8")
    return tomllib.loads(manifest)["version"]


def _hand_record(hand: HandRecord) -> dict[str, Any]:
    return {
        "side": hand.pose.side,
        "theta": hand.pose.theta.tolist(),
        "beta": hand.pose.beta.tolist(),
        "transl": hand.pose.transl.tolist(),
        "hand_sha256": hand.hand_sha256,
        "avatar": {
            "name": hand.avatar_name,
            "path": str(hand.avatar_path.resolve()),
            "sha256": _file_sha256(hand.avatar_path, hand.avatar_path.stat().st_mtime_ns),
        },
    }


@cache
def _file_sha256(path: Path, changed_ns: int) -> str:
    """Computed once per file and modification time."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
