"""The provenance of a frame, stored as JSON beside it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.shot import HandPose
from .digests import file_digest
from .shot_version import ShotVersion


@dataclass(frozen=True)
class HandRecord:
    """One hand of a frame, as it was rendered.

    Attributes:
        pose: its parameters.
        avatar_name: the name in the avatar's file.
        avatar_path: the avatar's file.
        hand_sha256: of the hand model's file.
        licence: of the avatar, or empty.
        consent: what its person agreed to, or empty.
    """

    pose: HandPose
    avatar_name: str
    avatar_path: Path
    hand_sha256: str
    licence: str = ""
    consent: str = ""


def frame_record(
    shot: Path,
    frame: int,
    size_px: tuple[int, int],
    camera: Camera,
    hands: Sequence[HandRecord],
    formats: Sequence[str],
    version: ShotVersion,
) -> dict[str, Any]:
    """Describe the provenance of a frame's files as a JSON object.

    Args:
        shot: the .blend.
        frame: its number.
        size_px: (width, height) of the frame's files.
        camera: of the rendered region, which is the whole image unless the scene has a render border.
        hands: all hands in the frame.
        formats: of the files.
        version: of the shot.

    Raises:
        LiveHandError: a hand's avatar or model is not one that the version names.
    """
    records = [_hand_record(hand) for hand in hands]
    _check_that_files_stayed(hands, records, version)
    return {
        "livehand": livehand_version(),
        "shot": str(shot.resolve()),
        "frame": frame,
        "size_px": list(size_px),
        "camera": {
            "K": camera.K.tolist(),
            "cam2world": camera.cam2world.tolist(),
            "size_px": list(camera.size_px),
            "projection": "orthographic" if camera.is_orthographic else "perspective",
        },
        "hands": records,
        "formats": list(formats),
        "version": version.to_record(),
    }


def save_record(record: dict[str, Any], path: Path) -> None:
    """Write the record as one line; raises OSError."""
    path.write_text(json.dumps(record) + "\n", encoding="utf-8")


@cache
def livehand_version() -> str:
    """Read the version in the manifest."""
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
            "sha256": file_digest(hand.avatar_path),
            "licence": hand.licence,
            "consent": hand.consent,
        },
    }


def _check_that_files_stayed(
    hands: Sequence[HandRecord], records: Sequence[dict[str, Any]], version: ShotVersion
) -> None:
    for hand, record in zip(hands, records, strict=True):
        if record["avatar"]["sha256"] not in version.avatars:
            raise LiveHandError(
                f"the avatar {hand.avatar_path} must stay as it is while a shot is rendered, it was changed; run the "
                "same command again"
            )
