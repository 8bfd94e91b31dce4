"""Reads the version of the open shot: what its frames are made from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy

from ...backend.batch.digests import file_digest, files_digest
from ...backend.batch.provenance import livehand_version
from ...backend.batch.shot_version import ShotVersion
from ...backend.records.errors import LiveHandError
from ..rig.hand import all_hands
from ..scene.camera import output_size_px
from .hand_source import hand_source, read_device

_TILES = ("<UDIM>", "<UVTILE>")


def read_version(scene: bpy.types.Scene, shot: Path, opened: str | None, folder: Path) -> ShotVersion:
    """Read the version of the open shot, with the plan applied.

    Args:
        scene: of the shot.
        shot: the .blend.
        opened: the digest that it had before it was opened.
        folder: of the frames; what the shot reads there changes with every frame, and does not count.

    Raises:
        LiveHandError: the .blend was saved while it was opened.
    """
    if file_digest(shot) != opened:
        raise LiveHandError(f"{shot} must stay while it is opened, it was saved meanwhile; run the same command again")
    sources = [hand_source(hand) for hand in all_hands(scene)]
    device = read_device(scene)
    return ShotVersion(
        livehand=livehand_version(),
        blender=bpy.app.version_string,
        shot=opened,
        linked=dict(_linked_files(folder)),
        avatars=_digests(source.avatar_path for source in sources),
        hand_models=_digests(source.model_path for source in sources),
        size_px=output_size_px(scene.render),
        settings={
            "device": device.name,
            "precision": device.precision,
            **({"watermark": "on"} if scene.livehand.watermark else {}),
        },
    )


def _digests(paths: Iterator[Path]) -> frozenset[str]:
    return frozenset(digest for digest in map(file_digest, paths) if digest)


def _linked_files(folder: Path) -> Iterator[tuple[str, str | None]]:
    """Yield path and digest of each file that the .blend reads: libraries, images, films, caches, fonts, sounds."""
    sequences = {bpy.path.abspath(path, library=library) for path, library in _sequence_paths()}
    for name in sorted(set(bpy.utils.blend_paths(absolute=True, packed=False))):
        path = Path(name)
        if path.resolve().is_relative_to(folder.resolve()):
            continue
        if name in sequences or any(tile in name for tile in _TILES):
            yield name, files_digest(_siblings(path))
        elif path.is_dir():
            yield name, files_digest(path.iterdir())
        else:
            yield name, file_digest(path)


def _sequence_paths() -> Iterator[tuple[str, bpy.types.Library | None]]:
    for image in (*bpy.data.images, *bpy.data.movieclips):
        if image.source == "SEQUENCE":
            yield image.filepath, image.library


def _siblings(path: Path) -> Iterator[Path]:
    """Yield the files of a sequence or of tiles: those whose names begin as this one's does before its number."""
    stem = path.stem
    for tile in _TILES:
        stem = stem.partition(tile)[0]
    stem = stem.rstrip("0123456789")
    if path.parent.is_dir():
        yield from (one for one in path.parent.iterdir() if one.name.startswith(stem) and one.suffix == path.suffix)
