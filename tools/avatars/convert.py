"""Convert avatars of earlier formats to the one that this version writes, in place.

    python -m livehand.tools.avatars.convert FILE...

Nothing is trained: the networks' weights are the file's, to the precision of the format, and the surface is that of
the person on whose capture the avatar was trained, by reference to the base surface that ships.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import replace
from pathlib import Path

from ...backend.avatars.file import VERSION, load_avatar, read_header, save_avatar
from ...backend.surface.base_surface import on_base


def convert(path: Path) -> None:
    """Convert a file; its provenance then names the file that it was made of.

    Raises:
        LiveHandError: as `load_avatar` and `save_avatar`.
    """
    version, sha256 = read_header(path)["format_version"], hashlib.sha256(path.read_bytes()).hexdigest()
    if version == VERSION:
        return
    avatar = load_avatar(path)
    surface = None if avatar.surface is None else on_base(avatar.surface)
    origin = {"format_version": version, "sha256": sha256}
    save_avatar(replace(avatar, surface=surface, provenance={**avatar.provenance, "converted_from": origin}), path)


def main() -> None:
    """Convert files, as the command line says."""
    parser = argparse.ArgumentParser(description="Convert avatars of earlier formats to this version's, in place.")
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="avatars")
    for path in parser.parse_args().files:
        convert(path)


if __name__ == "__main__":
    main()
