"""The image files that a .blend uses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy


def unreadable_images() -> Iterator[tuple[str, str]]:
    """(name, reason) of each single-file image in the open .blend that is used and cannot be read."""
    for image in bpy.data.images:
        if image.source == "FILE" and image.users and image.packed_file is None:
            path = Path(bpy.path.abspath(image.filepath, library=image.library))
            reason = _fault(path)
            if reason:
                yield image.name, f"{path}: {reason}"


def _fault(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            return None if file.read(1) else "empty file"
    except OSError as error:
        return error.strerror
