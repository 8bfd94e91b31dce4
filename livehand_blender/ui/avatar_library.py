"""The avatars that a hand may choose among: their cards, read once, and their pictures as icons."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np

from ...backend.avatars.library import SKINS, shipped_avatar_path
from ...backend.avatars.metadata import AvatarMetadata, read_metadata
from ...backend.records.errors import LiveHandError
from ..render.hands.hand_source import hand_source
from .preferences import avatar_folder


class AvatarLibrary:
    """Cards and icons; close it before Blender's classes are unregistered."""

    def __init__(self):
        self._icons = bpy.utils.previews.new()
        self._cards: dict[Path, tuple[int, AvatarMetadata | LiveHandError]] = {}

    def close(self) -> None:
        """Give the icons back."""
        bpy.utils.previews.remove(self._icons)

    def offered(self, context: bpy.types.Context, armature: bpy.types.Object) -> list[AvatarMetadata]:
        """Avatars of the hand's own model; what is no avatar is left out.

        Those that ship, those in the folder of the preferences, those beside the file it wears, and those beside its
        model's.
        """
        paths = dict.fromkeys(path.resolve() for path in _candidates(context, armature))
        cards = (self._read(path) for path in paths)
        wanted = armature.livehand.model_sha256
        return [card for card in cards if isinstance(card, AvatarMetadata) and card.hand_sha256 == wanted]

    def card(self, path: Path) -> AvatarMetadata:
        """An avatar's card.

        Raises:
            LiveHandError: as `read_metadata`.
        """
        found = self._read(path.resolve())
        if isinstance(found, LiveHandError):
            raise found
        return found

    def icon(self, card: AvatarMetadata) -> int:
        """Blender's number of the card's picture; 0, which is no icon, where it has none."""
        if card.thumbnail is None:
            return 0
        name = f"{card.path} {self._cards[card.path][0]}"
        if name not in self._icons:
            preview = self._icons.new(name)
            height, width = card.thumbnail.shape[:2]
            preview.image_size = (width, height)
            preview.image_pixels_float.foreach_set(_premultiplied(card.thumbnail)[::-1].ravel())
        return self._icons[name].icon_id

    def _read(self, path: Path) -> AvatarMetadata | LiveHandError:
        """Errors are kept too: a panel asks at every redraw."""
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        if self._cards.get(path, (None,))[0] != stamp:
            try:
                self._cards[path] = stamp, read_metadata(path)
            except LiveHandError as error:
                self._cards[path] = stamp, error
        return self._cards[path][1]


def _premultiplied(thumbnail: np.ndarray) -> np.ndarray:
    """[H, W, 4] float32 in 0..1: as Blender draws icons; straight alpha would give the hand a bright rim."""
    pixels = thumbnail.astype(np.float32) / 255
    pixels[..., :3] *= pixels[..., 3:]
    return pixels


def _candidates(context: bpy.types.Context, armature: bpy.types.Object) -> Iterator[Path]:
    yield from (shipped_avatar_path(skin) for skin in SKINS)
    source = hand_source(armature)
    yield source.avatar_path
    folders = [avatar_folder(context), source.avatar_path.parent, source.model_path and source.model_path.parent]
    for folder in filter(None, folders):
        yield from sorted(folder.glob("*.safetensors"))
