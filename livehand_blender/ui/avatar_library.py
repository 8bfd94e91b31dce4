"""The avatars that a hand can use: their metadata, read once, and their thumbnails as icons."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np

from ...backend.avatars.library import SHIPPED, shipped_avatar_path
from ...backend.avatars.metadata import AvatarMetadata, read_metadata
from ...backend.records.errors import LiveHandError
from ..render.hand_source import hand_source
from .preferences import avatar_folder, library_folder


class AvatarLibrary:
    """Metadata and icons; close it before Blender's classes are unregistered."""

    def __init__(self):
        self._icons = bpy.utils.previews.new()
        self._read: dict[Path, tuple[int, AvatarMetadata | LiveHandError]] = {}

    def close(self) -> None:
        """Free the icons."""
        bpy.utils.previews.remove(self._icons)

    def offered(self, context: bpy.types.Context, armature: bpy.types.Object) -> list[AvatarMetadata]:
        """List avatars of the hand's own model: LiveHand's, and those in some folders.

        The folders are those of avatars made in Blender, of the preferences, of the hand's avatar and of its model.
        Files that are not avatars are left out.
        """
        paths = dict.fromkeys(path.resolve() for path in _candidates(context, armature))
        found = (self._metadata(path) for path in paths)
        sha256 = armature.livehand.model_sha256
        return [avatar for avatar in found if isinstance(avatar, AvatarMetadata) and avatar.hand_sha256 == sha256]

    def metadata(self, path: Path) -> AvatarMetadata:
        """Read an avatar's metadata.

        Raises:
            LiveHandError: as `read_metadata`.
        """
        found = self._metadata(path.resolve())
        if isinstance(found, LiveHandError):
            raise found
        return found

    def icon(self, avatar: AvatarMetadata) -> int:
        """Return Blender's number of the thumbnail's icon; 0 (no icon) if the avatar has no thumbnail."""
        if avatar.thumbnail is None:
            return 0
        name = f"{avatar.path} {self._read[avatar.path][0]}"
        if name not in self._icons:
            preview = self._icons.new(name)
            height, width = avatar.thumbnail.shape[:2]
            preview.image_size = (width, height)
            preview.image_pixels_float.foreach_set(_premultiplied(avatar.thumbnail)[::-1].ravel())
        return self._icons[name].icon_id

    def _metadata(self, path: Path) -> AvatarMetadata | LiveHandError:
        """Read metadata; errors are remembered too, because panels call this at every redraw."""
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        if self._read.get(path, (None,))[0] != stamp:
            try:
                self._read[path] = stamp, read_metadata(path)
            except LiveHandError as error:
                self._read[path] = stamp, error
        return self._read[path][1]


def _premultiplied(thumbnail: np.ndarray) -> np.ndarray:
    """Premultiply to [H, W, 4] float32 in 0..1, as Blender draws icons; straight alpha would give a bright rim."""
    pixels = thumbnail.astype(np.float32) / 255
    pixels[..., :3] *= pixels[..., 3:]
    return pixels


def _candidates(context: bpy.types.Context, armature: bpy.types.Object) -> Iterator[Path]:
    yield from map(shipped_avatar_path, SHIPPED)
    source = hand_source(armature)
    yield source.avatar_path
    folders = [library_folder(context), avatar_folder(context), source.avatar_path.parent, source.model_path.parent]
    for folder in filter(None, folders):
        yield from sorted(folder.glob("*.safetensors"))
