"""Pictures on disk, numbered or not, as images of Blender's."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.records.errors import LiveHandError

_NUMBERED = re.compile(r"(.*?)(\d+)(\.[^.]+)")


@dataclass(frozen=True)
class PictureFiles:
    """A still, a movie, or the numbered pictures of one name in a folder.

    Attributes:
        path: of the first.
        source: `FILE`, `MOVIE` or `SEQUENCE`, as Blender calls them.
        first_frame: the number of the first picture; 1 for a still and a movie.
        last_frame: of the last picture of a sequence; numbers in between may be missing.
    """

    path: Path
    source: str
    first_frame: int = 1
    last_frame: int = 1

    @classmethod
    def find(cls, path: Path, is_still: bool = False) -> PictureFiles:
        """The files that `path` is one of; a still is one by itself, whatever its name.

        Raises:
            LiveHandError: there is no such file.
        """
        if not path.is_file():
            raise LiveHandError(f"no picture at {path}; choose a picture or one frame of a sequence")
        if path.suffix.lower() in bpy.path.extensions_movie:
            return cls(path, "MOVIE")
        siblings = {} if is_still else _numbered_siblings(path)
        if len(siblings) < 2:
            return cls(path, "FILE")
        return cls(siblings[min(siblings)], "SEQUENCE", min(siblings), max(siblings))

    def load(self) -> bpy.types.Image:
        """Blender's image of them; one that is there already for the same files is taken.

        Raises:
            LiveHandError: Blender cannot read them.
        """
        for image in bpy.data.images:
            if image.source == self.source and image.filepath and Path(bpy.path.abspath(image.filepath)) == self.path:
                return image
        try:
            image = bpy.data.images.load(str(self.path))
        except RuntimeError as error:
            raise LiveHandError(f"{self.path} must be a picture that Blender can read; {error}") from error
        image.source = self.source
        return image


def _numbered_siblings(path: Path) -> dict[int, Path]:
    """Number -> file, of all in the folder with the same name before the number and the same suffix."""
    own = _NUMBERED.fullmatch(path.name)
    if own is None:
        return {}
    matches = {other: _NUMBERED.fullmatch(other.name) for other in path.parent.iterdir()}
    return {
        int(match[2]): other for other, match in matches.items() if match and (match[1], match[3]) == (own[1], own[3])
    }
