"""The avatars that ship with LiveHand, all of the built-in hand, named by their skin."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal, get_args

Skin = Literal["light", "deep"]
SKINS: tuple[Skin, ...] = get_args(Skin)
AVATAR_HELP = f"avatar file, or an avatar that ships with LiveHand: {', '.join(SKINS)} (default: {SKINS[0]})"
"""Help text of the option `--avatar`."""


def shipped_avatar_path(skin: Skin = "light") -> Path:
    """The file of a shipped avatar."""
    return Path(str(resources.files(str(__package__)) / f"{skin}.safetensors"))


def avatar_path(name: str) -> Path:
    """The file of the shipped avatar with this skin; any other name is a path."""
    return shipped_avatar_path(name) if name in SKINS else Path(name)
