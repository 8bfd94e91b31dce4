"""`livehand sign` puts a signed manifest (C2PA) into pictures and films, by the user's own certificate."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..avatars.library import avatar_path
from ..avatars.origin import read_origin
from ..batch.content_credentials import add_signing_arguments, check_signable, read_signing_key, sign_file
from ..batch.frame_records import read_records, record_of
from ..records.errors import LiveHandError
from ..system.command import Command
from ..system.readers import opened_picture
from .origin import TEXT_KEYS, origin_facts


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="PNG, JPEG or MP4 files; they are replaced")
    add_signing_arguments(parser, is_required=True)
    parser.add_argument(
        "--avatar",
        type=avatar_path,
        nargs="+",
        default=[],
        metavar="NAME|FILE",
        help="the avatars shown (default: those that the metadata of a frame, or the record beside it, names)",
    )


def _run(args: argparse.Namespace) -> dict[str, Any]:
    signing = read_signing_key(args.certificate, args.private_key)
    for path in args.files:  # all, before the first is changed
        check_signable(path)
    origins = [_origin(path, args.avatar) for path in args.files]
    for path, origin in zip(args.files, origins, strict=True):
        sign_file(path, signing, origin)
    return {"signed": [str(path) for path in args.files], "summary": f"{len(args.files)} signed"}


def _origin(path: Path, avatars: Sequence[Path]) -> dict[str, Any]:
    """Return what a manifest says of the avatars that a file shows.

    Raises:
        LiveHandError: nothing tells.
    """
    if avatars:
        return origin_facts([read_origin(avatar) for avatar in avatars])
    if path.suffix.lower() == ".png":
        with opened_picture(path) as picture:
            picture.load()
            entries = {name: str(picture.info.get(key, "")) for name, key in TEXT_KEYS.items()}
        if entries["name"]:
            return {"avatars": [entries]}
    suffix = path.suffix.lower().removeprefix(".")
    record = record_of(read_records(path.with_suffix(".json"), [suffix]), suffix)
    if record and record.get("hands"):
        names = ("name", "licence", "consent")
        return {"avatars": [{name: hand["avatar"].get(name, "") for name in names} for hand in record["hands"]]}
    raise LiveHandError(f"{path} does not tell which avatar it shows; name it with --avatar")


COMMAND = Command("sign", "sign pictures and films with your certificate", _add_arguments, _run)
