"""The avatars that ship with LiveHand, of the built-in hand: three that were trained, and six people of numbers."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Literal, get_args

from ..hand.model_file import DEFAULT_HAND
from ..records.errors import LiveHandError
from ..system.files import is_file

Skin = Literal["light", "middle", "deep"]
SKINS: tuple[Skin, ...] = get_args(Skin)
"""Of the avatars that were trained."""
Shipped = Literal[Skin, "lena", "tomas", "mei", "ravi", "amara", "samuel"]
SHIPPED: tuple[Shipped, ...] = get_args(Shipped)
"""All that ship; those that were not trained are records (`drawn_people`)."""
PERSONS: dict[Shipped, str] = {
    "light": "Erik",
    "middle": "Maya",
    "deep": "Joseph",
    **{name: name.capitalize() for name in SHIPPED[len(SKINS) :]},
}
"""What the people of these avatars are called, who are invented."""
AVATAR_HELP = f"avatar file, or an avatar that ships with LiveHand: {', '.join(SHIPPED)} (default: {SKINS[0]})"
"""Help text of the option `--avatar`."""


@cache
def shipped_avatar_path(skin: Shipped = "light") -> Path:
    """Return the file of the avatar of this name."""
    return Path(str(resources.files(str(__package__)))) / DEFAULT_HAND / f"{skin}.safetensors"


def shipped_skin(path: Path) -> Shipped | None:
    """Return the name of a shipped avatar's file; None: it did not ship."""
    return next((skin for skin in SHIPPED if path.resolve() == shipped_avatar_path(skin).resolve()), None)


def person_name(path: Path, name: str) -> str:
    """Return what to call the person of an avatar's file, whose own name is given if it did not ship."""
    skin = shipped_skin(path)
    return name if skin is None else PERSONS[skin]


def check_avatar_path(path: Path) -> None:
    """Raise LiveHandError if there is no file, as where a name that ships is mistyped."""
    if not is_file(path):
        raise LiveHandError(
            f"no avatar at {path}; give the path of an avatar's .safetensors file, or a name: {', '.join(SHIPPED)}"
        )


def avatar_path(name: str) -> Path:
    """Return the file of the shipped avatar of this name, or of its person's; any other name is a path."""
    return next((shipped_avatar_path(skin) for skin in SHIPPED if name in (skin, PERSONS[skin])), Path(name))
