"""The metadata by which users choose an avatar; they are read without torch and without the weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import check_regular
from ..system.readers import parse_json

HEADER_KEY = "livehand"
"""The entry of the file's metadata that holds the header, in JSON."""
THUMBNAIL_KEY = "portrait"
"""The name of the thumbnail's tensor since format version 1."""

WATERMARK_KEY = "watermark"
"""Of the provenance: the bits with which all frames of the avatar are marked, 16 hexadecimal digits."""
_WATERMARK_BYTES = 8
_BETAS = 10
# The hardest split first.
_SPLITS = {
    "test": "unseen poses and cameras",
    "novel_pose": "unseen poses",
    "novel_camera": "unseen cameras",
    "novel_light": "unseen light",
}


@dataclass(frozen=True)
class AvatarMetadata:
    """The metadata of an avatar's file; the weights are not checked.

    Attributes:
        path: of the file.
        name: for display.
        hand_sha256: identity of the hand model it belongs to.
        hand_name: of that model.
        licence: of the avatar, or empty.
        consent: what the person whom it shows agreed to, or empty.
        figures: metrics on held-out views as lines of text; empty if it was not evaluated.
        made_from: the capture it was trained on as a line of text, or empty.
        beta: [10] shape of the person whom it shows, or None if the file does not say.
        thumbnail: [P, P, 4] uint8 sRGB with straight alpha, top row first; None if the file has none.
        watermark: 8 bytes with which its frames are marked, or None.
    """

    path: Path
    name: str
    hand_sha256: str
    hand_name: str
    licence: str
    consent: str
    figures: tuple[str, ...]
    made_from: str
    beta: tuple[float, ...] | None
    thumbnail: np.ndarray | None
    watermark: bytes | None = None


def read_metadata(path: Path) -> AvatarMetadata:
    """Read the metadata of an avatar's file.

    Raises:
        LiveHandError: the file is missing or not an avatar, or safetensors is not installed.
    """
    header, thumbnail = _read(path)
    try:
        provenance = header["provenance"]
        return AvatarMetadata(
            path=path,
            name=str(header["name"]),
            hand_sha256=str(header["hand_sha256"]),
            hand_name=str(header["hand_name"]),
            licence=licence_and_consent(provenance)[0],
            consent=licence_and_consent(provenance)[1],
            figures=_figures(header["metrics"]),
            made_from=_made_from(provenance.get("capture", {})),
            beta=_beta(header.get("surface"), provenance.get("capture", {})),
            thumbnail=thumbnail,
            watermark=watermark_of(provenance),
        )
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise LiveHandError(
            f"{path} must be an avatar of this version, got a header in which {error} is missing or wrong"
        ) from error


def _read(path: Path) -> tuple[dict[str, Any], np.ndarray | None]:
    try:
        from safetensors import SafetensorError, safe_open
    except ImportError as error:
        raise LiveHandError(
            "avatars need the package safetensors, got none; install it with: pip install safetensors"
        ) from error
    try:
        check_regular(path)
        with safe_open(path, framework="numpy") as archive:
            metadata = archive.metadata() or {}
            thumbnail = archive.get_tensor(THUMBNAIL_KEY) if THUMBNAIL_KEY in archive.keys() else None
            if thumbnail is not None and (thumbnail.dtype != np.uint8 or thumbnail.shape[2:] != (4,)):
                raise ValueError(f"a thumbnail {list(thumbnail.shape)} of {thumbnail.dtype}")
            return parse_json(metadata[HEADER_KEY].encode(), HEADER_KEY), thumbnail
    except (SafetensorError, LiveHandError, OSError, KeyError, ValueError, TypeError) as error:
        raise LiveHandError(
            f"{path} must be a LiveHand avatar (.safetensors), got {type(error).__name__}: {error}; choose another file"
        ) from error


def _figures(metrics: dict[str, Any]) -> tuple[str, ...]:
    """Return PSNR and SSIM of the hardest split that was evaluated."""
    measured = next((split for split in _SPLITS if split in metrics), None)
    if measured is None:
        return ()
    values = metrics[measured]
    return (
        f"PSNR {values['psnr_full']:.1f} dB, hand alone {values['psnr_hand']:.1f} dB",
        f"SSIM {values['ssim']:.3f}, alpha IoU {values['alpha_iou']:.3f}",
        f"on {values['images']:.0f} views of {_SPLITS[measured]}",
    )


def licence_and_consent(provenance: Mapping[str, Any]) -> tuple[str, str]:
    """Return an avatar's licence, and what its person agreed to, both perhaps empty.

    A consent is that which was given when this avatar was made, or the one that it was fine-tuned from.
    """
    before = (provenance.get("fine_tuned_from") or {}).get("provenance") or {}
    consent = provenance.get("consent") or (licence_and_consent(before)[1] if before else "")
    return str(provenance.get("licence") or ""), str(consent)


def watermark_of(provenance: Mapping[str, Any]) -> bytes | None:
    """Return the bits with which an avatar's frames are marked; None: with none.

    Raises:
        LiveHandError: they are no 8 bytes.
    """
    text = provenance.get(WATERMARK_KEY)
    if text is None:
        return None
    try:
        payload = bytes.fromhex(text)
    except (TypeError, ValueError):
        payload = b""
    if len(payload) != _WATERMARK_BYTES:
        raise LiveHandError(
            f"an avatar's watermark must be {2 * _WATERMARK_BYTES} hexadecimal digits, got {str(text)[:40]}"
        )
    return payload


def _made_from(capture: dict[str, Any]) -> str:
    made_by, plan = capture.get("made_by", ""), capture.get("plan") or {}
    if not {"poses", "size_px"} <= plan.keys():
        return made_by
    poses = plan.get("first_poses") or plan["poses"]
    return f"{made_by}: {poses} poses, {'x'.join(map(str, plan['size_px']))} px"


def _beta(surface: dict[str, Any] | None, capture: dict[str, Any]) -> tuple[float, ...] | None:
    person = (surface or capture.get("plan") or {}).get("person") or {}
    if person.get("beta") is None:
        return None
    beta = tuple(float(value) for value in person["beta"])
    if len(beta) != _BETAS or not np.isfinite(beta).all():
        raise ValueError(f"a person's beta {beta}")
    return beta
