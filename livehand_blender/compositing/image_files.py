"""Image files on disk, numbered or not, as Blender images."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.records.errors import LiveHandError

_NUMBERED = re.compile(r"(.*?)(\d+)(\.[^.]+)")


@dataclass(frozen=True)
class ImageFiles:
    """A still, a movie, or a numbered image sequence.

    Attributes:
        path: of the still, the movie or the first image.
        source: `FILE`, `MOVIE` or `SEQUENCE`, as Blender calls them.
        first_frame: the number of the first image; 1 for a still or a movie.
        last_frame: the number of the last image; numbers in between may be missing.
    """

    path: Path
    source: str
    first_frame: int = 1
    last_frame: int = 1

    @classmethod
    def find(cls, path: Path, is_still: bool = False) -> ImageFiles:
        """Find the files that `path` belongs to; a still is always a file of its own.

        Raises:
            LiveHandError: the file does not exist.
        """
        if not path.is_file():
            raise LiveHandError(f"no image at {path}; choose an image or one frame of a sequence")
        if path.suffix.lower() in bpy.path.extensions_movie:
            return cls(path, "MOVIE")
        siblings = {} if is_still else _numbered_siblings(path)
        if len(siblings) < 2:
            return cls(path, "FILE")
        return cls(siblings[min(siblings)], "SEQUENCE", min(siblings), max(siblings))

    def load(self) -> bpy.types.Image:
        """Load the Blender image of the files; an existing one is used again.

        Raises:
            LiveHandError: Blender cannot read them.
        """
        for image in bpy.data.images:
            if image.source == self.source and image.filepath and Path(bpy.path.abspath(image.filepath)) == self.path:
                return image
        try:
            image = bpy.data.images.load(str(self.path))
        except RuntimeError as error:
            raise LiveHandError(f"{self.path} must be an image that Blender can read; {error}") from error
        image.source = self.source
        return image


def _numbered_siblings(path: Path) -> dict[int, Path]:
    """Map number to file, for files of the folder with the same name before the number and the same suffix."""
    own = _NUMBERED.fullmatch(path.name)
    if own is None:
        return {}
    matches = {other: _NUMBERED.fullmatch(other.name) for other in path.parent.iterdir()}
    return {
        int(match[2]): other for other, match in matches.items() if match and (match[1], match[3]) == (own[1], own[3])
    }
