"""`livehand thumbnail`: renders the thumbnail of an avatar's file again; training renders the first one."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("avatar", type=Path, help=".safetensors file to update")
    parser.add_argument("--hand", type=Path, help="hand model of the avatar (default: its built-in one)")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda", "mps"), default="auto")


def _run(args: argparse.Namespace) -> dict:
    from ..avatars.file import check_keeps_networks, load_avatar, save_avatar
    from ..hand.model_file import DEFAULT_HAND, load_hand_model
    from .renderer import Renderer
    from .thumbnail import render_thumbnail

    check_keeps_networks(args.avatar)
    avatar = load_avatar(args.avatar)
    hand = load_hand_model(args.hand or DEFAULT_HAND)
    save_avatar(replace(avatar, thumbnail=render_thumbnail(Renderer(avatar, hand, args.device))), args.avatar)
    return {"avatar": str(args.avatar), "summary": f"{args.avatar}: thumbnail rendered"}


COMMAND = Command("thumbnail", "render the thumbnail of an avatar again", _add_arguments, _run)
