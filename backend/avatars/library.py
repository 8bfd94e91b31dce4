"""The avatars that ship with LiveHand, named by their skin, of each of the built-in hands."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal, get_args

from ..hand.model_file import DEFAULT_HAND, builtin_name

Skin = Literal["light", "middle", "deep"]
SKINS: tuple[Skin, ...] = get_args(Skin)
AVATAR_HELP = f"avatar file, or an avatar that ships with LiveHand: {', '.join(SKINS)} (default: {SKINS[0]})"
"""Help text of the option `--avatar`."""


def shipped_avatar_path(skin: Skin = "light", hand_sha256: str | None = None) -> Path:
    """The file of the avatar with this skin of a built-in hand; None, or the hash of another hand: the default one."""
    hand = DEFAULT_HAND if hand_sha256 is None else builtin_name(hand_sha256)
    return Path(str(resources.files(str(__package__)))) / hand / f"{skin}.safetensors"


def shipped_skins(hand_sha256: str | None = None) -> tuple[Skin, ...]:
    """The skins of which that built-in hand has an avatar: the hand without an arm has no middle one."""
    return tuple(skin for skin in SKINS if shipped_avatar_path(skin, hand_sha256).is_file())


def shipped_skin(path: Path) -> Skin | None:
    """The skin of a shipped avatar's file, of whichever hand; None: it did not ship."""
    folder = Path(str(resources.files(str(__package__)))).resolve()
    is_shipped = path.resolve().parent.parent == folder and path.suffix == ".safetensors"
    return next((skin for skin in SKINS if is_shipped and path.stem == skin), None)


def avatar_path(name: str) -> Path:
    """The file of the default hand's avatar with this skin; any other name is a path."""
    return next((shipped_avatar_path(skin) for skin in SKINS if skin == name), Path(name))
