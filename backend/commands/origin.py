"""`livehand origin` tells which avatar a picture or a film shows: by its watermark, its metadata and its signature."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..avatars.library import SHIPPED, shipped_avatar_path
from ..avatars.origin import Origin, joint_payload, read_origin
from ..batch.content_credentials import SIGNED_SUFFIXES, can_sign, read_manifest
from ..system.command import Command
from ..system.files import check_regular, is_folder
from ..system.readers import opened_picture

if TYPE_CHECKING:
    from ..image.watermark.detection import Reading

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
TEXT_KEYS = {"name": "LiveHand/Avatar", "licence": "LiveHand/License", "consent": "LiveHand/Consent"}
"""Entries of a picture's metadata by their names in an origin."""
_MATCHING_BITS = 52  # of 64: a random payload reaches that once in ten million
_MOST_FRAMES = 48  # of a film


def origin_facts(origins: Sequence[Origin]) -> dict[str, Any]:
    """Describe the avatars of a picture, for a manifest."""
    return {"avatars": [{"name": one.name, "licence": one.licence, "consent": one.consent} for one in origins]}


def origin_text(origins: Sequence[Origin]) -> dict[str, str]:
    """Describe the avatars of a picture as entries of its metadata; what nobody stated is left out."""
    joined = {key: "; ".join(filter(None, (getattr(one, name) for one in origins))) for name, key in TEXT_KEYS.items()}
    return {key: value for key, value in joined.items() if value}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="a picture, a film, or an avatar")
    parser.add_argument(
        "--avatar",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE|DIR",
        help="avatars to compare with, beside those that ship",
    )
    parser.add_argument(
        "--scale",
        type=_scale,
        metavar="SHARE",
        help="size of the picture against the rendered one, such as 0.6 (default: halves, thirds, quarters, doubles)",
    )


def _scale(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0.05 <= value <= 20:
        raise argparse.ArgumentTypeError(f"must be a number from 0.05 to 20, got {text!r}")
    return value


def _run(args: argparse.Namespace) -> dict[str, Any]:
    check_regular(args.file)
    if args.file.suffix == ".safetensors":
        return _reported(_avatar_facts(args.file))
    from ..image.watermark.detection import SCALES, WatermarkReader

    candidates = [read_origin(path) for path in _avatar_files(args.avatar)]
    reader = WatermarkReader((args.scale,) if args.scale else SCALES)
    for picture, is_compressed_alone in _pictures(args.file):
        reader.add(picture, is_compressed_alone)
    facts = {
        **_watermark_facts(reader.reading(), candidates),
        "metadata": _text_of(args.file),
        "signature": _signature(args.file),
    }
    return _reported(facts)


def _avatar_facts(path: Path) -> dict[str, Any]:
    """Tell an avatar's own bits, whether its frames are marked with them, and what its map of albedo says."""
    from ..avatars.file import read_surface_of
    from ..avatars.marking import mark_in_albedo

    one, surface = read_origin(path), read_surface_of(path)
    found = None if surface is None else mark_in_albedo(surface.arrays)
    facts = {"avatar": one.name, "licence": one.licence, "consent": one.consent, "bits": one.payload.hex()}
    albedo = found.payload.hex() if found is not None and found.is_sure else None
    return {**facts, "marks_frames": one.is_marked, "albedo": albedo}


def _watermark_facts(reading: Reading, candidates: Sequence[Origin]) -> dict[str, Any]:
    """Compare what was read with every avatar, and with every pair, which one picture may show."""
    groups = [*((one,) for one in candidates), *combinations(candidates, 2)]
    agreement, best = max(
        ((reading.agreement(joint_payload(one.payload for one in group)), group) for group in groups),
        key=lambda scored: scored[0],
        default=(0, ()),
    )
    is_match = agreement >= _MATCHING_BITS
    facts: dict[str, Any] = {"watermark": is_match or reading.is_sure, "score": round(reading.score, 2)}
    if facts["watermark"]:
        facts |= {"bits": reading.payload.hex(), "scale": round(reading.scale, 4)}
    if is_match:
        facts |= {"matching_bits": agreement, **origin_facts(best)}
    return facts


def _avatar_files(named: Sequence[Path]) -> Iterator[Path]:
    yield from (shipped_avatar_path(skin) for skin in SHIPPED)
    for path in named:
        yield from sorted(path.glob("*.safetensors")) if is_folder(path) else (path,)


def _pictures(path: Path) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield the picture, or frames of a film, uint8 [H, W, 3] on black, each with whether it was compressed alone."""
    if path.suffix.lower() in PICTURES:
        with opened_picture(path) as picture:
            pixels = np.asarray(picture.convert("RGBA"), np.float32)
        yield (pixels[..., :3] * (pixels[..., 3:] / 255)).round().astype(np.uint8), True
        return
    from ..tracking.video import open_video

    video = open_video(path)
    step = max(1, video.count // _MOST_FRAMES)
    for index, frame in enumerate(video.decoded()):
        is_key = bool(frame.decoded.key_frame)
        if is_key or index % step == 0:
            yield frame.picture(), is_key


def _text_of(path: Path) -> Mapping[str, str]:
    """Read the entries of a PNG that tell of avatars."""
    if path.suffix.lower() != ".png":
        return {}
    with opened_picture(path) as picture:
        picture.load()
        return {key: str(picture.info[key]) for key in TEXT_KEYS.values() if key in picture.info}


def _signature(path: Path) -> dict[str, Any] | str | None:
    """Report the manifest of a file that can have one; None: it has none."""
    if path.suffix.lower() not in SIGNED_SUFFIXES:
        return None
    if not can_sign():
        return "not read: it needs the package c2pa-python"
    manifest = read_manifest(path)
    if manifest is None:
        return None
    return {
        "valid": manifest.is_valid,
        "faults": list(manifest.faults),
        "signer": manifest.signer,
        "issuer": manifest.issuer,
        "origin": dict(manifest.origin),
    }


def _reported(facts: dict[str, Any]) -> dict[str, Any]:
    width = max(map(len, facts))
    return {**facts, "summary": "\n".join(f"{key:{width}s}  {value}" for key, value in facts.items())}


COMMAND = Command("origin", "tell which avatar a picture or a film shows", _add_arguments, _run)
