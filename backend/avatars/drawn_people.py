"""Avatars of invented people: the networks of the nearest person that ships, and a surface drawn from numbers.

A record is a file of an avatar without networks: a person's numbers, a thumbnail, and what users choose by. The first
time that it is loaded the person is drawn, which takes some 20 s, and kept in the user's own data.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..surface.base_surface import base_sha256
from ..surface.people.drawing import AtlasSizes
from ..surface.people.drawn_surface import drawn_surface
from ..surface.people.look import NUMBERS, PersonLook
from ..system.package_files import user_folder
from .avatar import Avatar
from .library import SKINS, shipped_avatar_path
from .network_albedo import FIELD_RESOLUTION, network_albedo
from .tensors import surface_tensors

MADE_BY = "livehand new-person"
LOOK_KEY = "look"
"""Of a record's header: the person's numbers."""
DRAWING = 9
"""Of how people are drawn: raise it when the same numbers give another skin."""
_FOLDER = "people"
_DIGITS = 12
Load = Callable[[Path], Avatar]


def nearest_base(tone: float, load: Load) -> Avatar:
    """Load the avatar that ships whose skin is nearest to a tone."""
    return min((load(shipped_avatar_path(skin)) for skin in SKINS), key=lambda avatar: abs(_melanin(avatar) - tone))


def drawn_avatar(
    hand: HandModel,
    look: PersonLook,
    name: str,
    base: Avatar,
    sizes: AtlasSizes = AtlasSizes(),  # noqa: B008
) -> Avatar:
    """Make the avatar, relightable and without training; it has no thumbnail.

    Args:
        hand: the built-in right one.
        look: of the person.
        name: for display.
        base: whose networks it has.
        sizes: of the maps.
    """
    surface = drawn_surface(hand, look, network_albedo(base, hand, FIELD_RESOLUTION), sizes)
    facts = {"made_by": MADE_BY, "base": base.name, "look": look.facts()}
    facts |= {key: base.provenance[key] for key in ("licence",) if key in base.provenance}
    return replace(base, name=name, surface=surface, provenance=facts, metrics={}, thumbnail=None)


def record_header(avatar: Avatar, look: PersonLook) -> dict[str, Any]:
    """Write out the header of a drawn person's record."""
    assert avatar.surface is not None
    surface, _ = surface_tensors(replace(avatar.surface, arrays={}))
    summary = ", ".join(f"{name} {value:g}" for name, value in look.facts().items())
    provenance = {key: value for key, value in avatar.provenance.items() if key != "look"}
    return {
        "name": avatar.name,
        "hand_name": avatar.hand_name,
        "hand_sha256": avatar.hand_sha256,
        "provenance": {**provenance, "capture": {"made_by": f"{MADE_BY}: {summary}"}},
        "metrics": avatar.metrics,
        "surface": surface,
        LOOK_KEY: look.facts(),
    }


def look_of(header: Mapping[str, Any], path: Path) -> PersonLook:
    """Read the numbers of a record's header.

    Raises:
        LiveHandError: one is missing, unknown, no number or beyond its limits.
    """
    numbers = header[LOOK_KEY]
    wanted = {"seed", *NUMBERS}
    if not isinstance(numbers, dict) or numbers.keys() != wanted:
        raise LiveHandError(f"{path}: its numbers must be {', '.join(sorted(wanted))}, got {str(numbers)[:80]}")
    if any(not isinstance(value, int | float) or isinstance(value, bool) for value in numbers.values()):
        raise LiveHandError(f"{path}: a person's numbers must be numbers, got {str(numbers)[:80]}")
    seed, given = numbers["seed"], {name: float(numbers[name]) for name in NUMBERS}
    return PersonLook.of(seed, given)


def made_path(path: Path, header: Mapping[str, Any]) -> Path:
    """Return where the avatar of a record is kept once it is made; another version of drawing or networks has another.

    Raises:
        LiveHandError: the user has no home.
    """
    look = json.dumps([header["name"], header[LOOK_KEY], header["hand_sha256"], base_sha256(), DRAWING], sort_keys=True)
    digest = hashlib.sha256(look.encode())
    for skin in SKINS:
        digest.update(shipped_avatar_path(skin).read_bytes())
    return user_folder(_FOLDER) / f"{path.stem}-{digest.hexdigest()[:_DIGITS]}.safetensors"


def made_avatar(path: Path, header: Mapping[str, Any], thumbnail: np.ndarray | None, load: Load) -> Avatar:
    """Draw the person of a record.

    Raises:
        LiveHandError: its numbers are wrong, or it is of another hand than the built-in one.
    """
    from ..hand.model_file import DEFAULT_HAND, load_hand_model

    look, hand = look_of(header, path), load_hand_model(DEFAULT_HAND)
    if header["hand_sha256"] != hand.sha256:
        raise LiveHandError(
            f"{path} must be of the built-in hand {hand.sha256[:12]}..., got {str(header['hand_sha256'])[:12]}...; "
            "use the version that made it"
        )
    base = nearest_base(look.tone, load)
    return replace(drawn_avatar(hand, look, str(header["name"]), base), thumbnail=thumbnail)


def _melanin(avatar: Avatar) -> float:
    assert avatar.surface is not None
    return avatar.surface.person.melanin
