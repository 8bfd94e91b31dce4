"""The avatars that ship with LiveHand, of the built-in hand, named by their skin."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal, get_args

from ..hand.model_file import DEFAULT_HAND

Skin = Literal["light", "middle", "deep"]
SKINS: tuple[Skin, ...] = get_args(Skin)
PERSONS: dict[Skin, str] = {"light": "Erik", "middle": "Maya", "deep": "Joseph"}
"""What the people of these avatars are called, who are invented."""
AVATAR_HELP = f"avatar file, or an avatar that ships with LiveHand: {', '.join(SKINS)} (default: {SKINS[0]})"
"""Help text of the option `--avatar`."""


def shipped_avatar_path(skin: Skin = "light") -> Path:
    """Return the file of the avatar with this skin."""
    return Path(str(resources.files(str(__package__)))) / DEFAULT_HAND / f"{skin}.safetensors"


def shipped_skin(path: Path) -> Skin | None:
    """Return the skin of a shipped avatar's file; None: it did not ship."""
    return next((skin for skin in SKINS if path.resolve() == shipped_avatar_path(skin).resolve()), None)


def person_name(path: Path, name: str) -> str:
    """Return what to call the person of an avatar's file, whose own name is given if it did not ship."""
    skin = shipped_skin(path)
    return name if skin is None else PERSONS[skin]


def avatar_path(name: str) -> Path:
    """Return the file of the shipped avatar with this skin; any other name is a path."""
    return next((shipped_avatar_path(skin) for skin in SKINS if skin == name), Path(name))
