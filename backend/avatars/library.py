"""The avatars that come with LiveHand, all of the built-in hand, known by their skin."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal, get_args

Skin = Literal["light", "deep"]
SKINS: tuple[Skin, ...] = get_args(Skin)
AVATAR_HELP = f"a file, or one that comes with LiveHand: {', '.join(SKINS)} (default: {SKINS[0]})"
"""Of the command line's `--avatar`."""


def shipped_avatar_path(skin: Skin = "light") -> Path:
    """The file of a shipped avatar."""
    return Path(str(resources.files(str(__package__)) / f"{skin}.safetensors"))


def avatar_path(name: str) -> Path:
    """A shipped avatar's file for the name of its skin; anything else is a file's path itself."""
    return shipped_avatar_path(name) if name in SKINS else Path(name)
