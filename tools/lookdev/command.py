"""`livehand lookdev`: its arguments and its run."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...backend.capture.person import find_person
from ...backend.system.command import Command, parse_count
from ...backend.system.files import replacing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of sheets and figures")
    parser.add_argument(
        "--person", default="light", metavar="NAME", help="as in livehand capture (default: %(default)s)"
    )
    parser.add_argument("--avatar", metavar="NAME", help="LiveHand's own frames of an avatar, not Cycles' of a person")
    parser.add_argument("--hand", type=Path, help="another of the built-in hands (default: the one new scenes get)")
    parser.add_argument(
        "--size", type=parse_count, default=400, metavar="PX", help="of a close-up's side (default: %(default)s)"
    )
    parser.add_argument(
        "--samples", type=parse_count, default=64, help="Cycles samples per pixel (default: %(default)s)"
    )
    parser.add_argument("--threads", type=parse_count, default=None, help="render threads (default: all)")


def run(args: argparse.Namespace) -> Mapping[str, Any]:
    """Render the sheets and measure; returns the figures."""
    from ...backend.avatars.file import load_avatar
    from ...backend.avatars.library import avatar_path
    from ...backend.hand.model_file import load_default_hand, load_hand_model
    from .sheets import look_at, look_at_avatar, summary

    model = load_hand_model(args.hand) if args.hand else load_default_hand()
    if args.avatar:
        figures = look_at_avatar(load_avatar(avatar_path(args.avatar)), model, args.output, args.size)
    else:
        person = find_person(args.person)
        figures = look_at(model, person, args.output, args.size, args.samples, args.threads)
    with replacing(args.output / "figures.json") as temporary:
        temporary.write_text(json.dumps(figures, indent=1))
    return figures | {"summary": summary(figures)}


COMMAND = Command(
    "lookdev",
    "render the built-in hand's look in a key light, and measure its contrast and colours",
    add_arguments,
    run,
)
