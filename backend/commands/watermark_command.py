"""`livehand watermark` marks an avatar: from then on it carries its bits, and so do all frames of it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("avatar", type=Path, help="the avatar to mark; it stays")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="AVATAR", help=".safetensors file to write")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    from ..avatars.file import load_avatar, save_avatar
    from ..avatars.marking import marked_avatar
    from ..avatars.origin import read_origin

    if args.output.suffix != ".safetensors":
        raise LiveHandError(f"an avatar's file must end in .safetensors, got {args.output.name}")
    origin, avatar = read_origin(args.avatar), load_avatar(args.avatar)
    save_avatar(marked_avatar(avatar, origin.payload), args.output)
    marked = "frames" if avatar.surface is None else "frames and map of albedo"
    summary = f"{args.output}: {origin.payload.hex()} in its {marked}"
    return {"avatar": str(args.output), "bits": origin.payload.hex(), "summary": summary}


COMMAND = Command("watermark", "mark an avatar, and with it all of its frames", _add_arguments, _run)
