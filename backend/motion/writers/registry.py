"""The formats that motions are written in, and which one a file's name means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...records.errors import LiveHandError
from .arrays import MANO, OWN, SMPLX
from .bvh import BVH
from .csv_table import CSV
from .mediapipe import MEDIAPIPE
from .openxr import OPENXR
from .writer import Writer

WRITERS: tuple[Writer, ...] = (OWN, MANO, SMPLX, OPENXR, MEDIAPIPE, CSV, BVH)
"""Those that need no Blender; of those that share a suffix, the first is meant where the user names none."""


def choose_writer(path: Path, name: str | None, writers: Sequence[Writer] = WRITERS) -> Writer:
    """Find the format of a file to be written, by the name that the user gives, else by the file's suffix.

    Raises:
        LiveHandError: there is none of that name or suffix, or the suffix is another format's.
    """
    suffix = path.suffix.lower()
    if name is None:
        found = next((writer for writer in writers if suffix in writer.suffixes), None)
        if found is None:
            known = ", ".join(dict.fromkeys(suffix for writer in writers for suffix in writer.suffixes))
            raise LiveHandError(f"the file's suffix must be one of {known}, got {path.name!r}; rename it")
        return found
    found = next((writer for writer in writers if writer.name == name), None)
    if found is None:
        raise LiveHandError(f"a format must be one of {', '.join(writer.name for writer in writers)}, got {name!r}")
    if suffix not in found.suffixes:
        raise LiveHandError(
            f"a file in {found.title} must end in {' or '.join(found.suffixes)}, got {path.name!r}; rename it"
        )
    return found
