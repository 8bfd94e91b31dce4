"""What people choose an avatar by: name, hand, licence, figures and picture, read without torch and without weights."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..records.errors import LiveHandError

# The hardest first.
_SPLITS = {
    "test": "unseen poses and cameras",
    "novel_pose": "unseen poses",
    "novel_camera": "unseen cameras",
}


@dataclass(frozen=True)
class AvatarMetadata:
    """An avatar's file at a glance; whether its weights are whole is not looked at.

    Attributes:
        path: of the file.
        name: for people.
        hand_sha256: identity of the hand model it belongs to.
        hand_name: of that model.
        licence: as whoever trained it said, or empty.
        figures: measured on held-out views, a line of text each; empty where nobody measured.
        made_from: the capture it learnt from, in a line of text, or empty.
        thumbnail: [P, P, 4] uint8 sRGB with straight alpha, top row first; None where the file has none.
    """

    path: Path
    name: str
    hand_sha256: str
    hand_name: str
    licence: str
    figures: tuple[str, ...]
    made_from: str
    thumbnail: np.ndarray | None


def read_metadata(path: Path) -> AvatarMetadata:
    """What the header of an avatar's file.

    Raises:
        LiveHandError: no such file, not an avatar, or safetensors is not installed.
    """
    header, thumbnail = _read(path)
    try:
        provenance = header["provenance"]
        return AvatarMetadata(
            path=path,
            name=str(header["name"]),
            hand_sha256=str(header["hand_sha256"]),
            hand_name=str(header["hand_name"]),
            licence=str(provenance.get("licence", "")),
            figures=_figures(header["metrics"]),
            made_from=_made_from(provenance.get("capture", {})),
            thumbnail=thumbnail,
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise LiveHandError(f"{path} must be an avatar of this version, got a header without {error}") from error


def _read(path: Path) -> tuple[dict[str, Any], np.ndarray | None]:
    try:
        from safetensors import SafetensorError, safe_open
    except ImportError as error:
        raise LiveHandError("avatars need the package safetensors, which is missing; install it with pip") from error
    try:
        with safe_open(path, framework="numpy") as archive:
            metadata = archive.metadata() or {}
            thumbnail = archive.get_tensor("portrait") if "portrait" in archive.keys() else None
            return json.loads(metadata["livehand"]), thumbnail
    except (SafetensorError, OSError, KeyError, ValueError) as error:
        raise LiveHandError(
            f"{path} must be a LiveHand avatar (.safetensors), got {type(error).__name__}: {error}; choose another file"
        ) from error


def _figures(metrics: dict[str, Any]) -> tuple[str, ...]:
    """PSNR and SSIM of the hardest split that was measured."""
    measured = next((split for split in _SPLITS if split in metrics), None)
    if measured is None:
        return ()
    of = metrics[measured]
    return (
        f"PSNR {of['psnr_full']:.1f} dB, hand alone {of['psnr_hand']:.1f} dB",
        f"SSIM {of['ssim']:.3f}, alpha IoU {of['alpha_iou']:.3f}",
        f"on {of['images']:.0f} views of {_SPLITS[measured]}",
    )


def _made_from(capture: dict[str, Any]) -> str:
    made_by, plan = capture.get("made_by", ""), capture.get("plan") or {}
    if not {"poses", "size_px"} <= plan.keys():
        return made_by
    poses = plan.get("first_poses") or plan["poses"]
    return f"{made_by}: {poses} poses, {'x'.join(map(str, plan['size_px']))} px"
