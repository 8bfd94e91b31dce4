"""The avatars that ship, as bases of people."""

from __future__ import annotations

from ..avatars.file import load_avatar
from ..avatars.library import shipped_avatar_path
from ..hand.model import HandModel
from .making import Bases
from .model import PersonModel

BASES = "light", "middle", "deep"


def shipped_bases(hand: HandModel) -> Bases:
    """Load them."""
    return Bases.of(PersonModel.of(load_avatar(shipped_avatar_path(name)), hand) for name in BASES)
