"""Writes the people who ship, with small thumbnails.

Six are records of numbers (`backend/avatars/drawn_people.py`); the three whose networks were trained get drawn colours
on the relief that these know.

python -m livehand.tools.avatars.people FOLDER [--only NAME ...]
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...backend.avatars.avatar import Avatar
from ...backend.avatars.file import load_avatar, save_avatar, write_record
from ...backend.avatars.library import PERSONS, SHIPPED, Shipped, shipped_avatar_path
from ...backend.avatars.network_albedo import FIELD_RESOLUTION, network_albedo
from ...backend.hand.model_file import load_default_hand
from ...backend.person.invented.command import new_person
from ...backend.render.thumbnail import with_thumbnail
from ...backend.surface.hair_growth import REGIONS
from ...backend.surface.people.drawing import AtlasSizes
from ...backend.surface.people.drawn_surface import grown
from ...backend.surface.people.look import PersonLook
from ...backend.surface.people.recolouring import recoloured_arrays
from ...backend.system.command import warn

_THUMBNAIL_PX = 96  # a record is hardly more than its thumbnail
PEOPLE: Mapping[Shipped, tuple[int, dict[str, float | None]]] = {
    "lena": (11, {"age": 24, "tone": 0.04, "build": 0.32, "freckles": 1.3, "hair": 0.15, "nails": 1.5, "veins": 0.14}),
    "tomas": (23, {"age": 58, "tone": 0.15, "build": 0.9, "freckles": 0.9, "hair": 1.6, "nails": 0.6, "veins": 0.5}),
    "mei": (36, {"age": 36, "tone": 0.28, "build": 0.12, "freckles": 0.1, "hair": 0.05, "nails": 0.9, "veins": 0.2}),
    "ravi": (41, {"age": 31, "tone": 0.58, "build": 0.68, "freckles": 0.2, "hair": 1.2, "nails": 0.6, "veins": 0.26}),
    "amara": (57, {"age": 45, "tone": 0.84, "build": 0.35, "freckles": 0.1, "hair": 0.1, "nails": 1.3, "veins": 0.3}),
    "samuel": (68, {"age": 74, "tone": 1.0, "build": 0.7, "freckles": 0.5, "hair": 0.6, "nails": 0.8, "veins": 0.6}),
}
"""By name: the seed, and the numbers that are not drawn from it."""


TRAINED: Mapping[Shipped, tuple[int, dict[str, float | None]]] = {
    "light": (101, {"age": 34, "tone": 0.14, "build": 0.7, "blood": 1.1, "freckles": 0.5, "hair": 0.7, "nails": 0.8}),
    "middle": (102, {"age": 29, "tone": 0.42, "build": 0.2, "blood": 1.0, "freckles": 0.2, "hair": 0.1, "nails": 1.2}),
    "deep": (103, {"age": 58, "tone": 1.0, "build": 0.7, "blood": 1.0, "freckles": 0.3, "hair": 0.5, "nails": 0.8}),
}
"""The colours and hair of those whose networks were trained; relief and shape stay those of their captures."""


def write_person(name: Shipped, folder: Path) -> None:
    """Write the file of one of them; some 20 s."""
    path = folder / f"{name}.safetensors"
    if name in TRAINED:
        seed, numbers = TRAINED[name]
        save_avatar(recoloured(load_avatar(shipped_avatar_path(name)), PersonLook.of(seed, numbers)), path)
        return
    seed, numbers = PEOPLE[name]
    look = PersonLook.of(seed, numbers)
    avatar = new_person(look, PERSONS[name], lambda line: None)
    write_record(_with_small_thumbnail(avatar), look, path)
    warn(f"{name}: {look.facts()}")


def recoloured(avatar: Avatar, look: PersonLook) -> Avatar:
    """Give a trained avatar a look's colours and hair; its figures stay those of its networks in their own colours."""
    hand, surface = load_default_hand(), avatar.surface
    assert surface is not None
    colours = recoloured_arrays(hand, look, network_albedo(avatar, hand, FIELD_RESOLUTION), AtlasSizes().ratio)
    hair = {name: grown(region, look) for name, region in REGIONS.items()}
    coloured = replace(
        avatar,
        surface=replace(surface, arrays={**surface.arrays, **colours}, hair=hair),
        provenance={**avatar.provenance, "recoloured": look.facts()},
    )
    return with_thumbnail(coloured, hand)


def _with_small_thumbnail(avatar: Avatar) -> Avatar:
    assert avatar.thumbnail is not None
    return replace(avatar, thumbnail=halved(avatar.thumbnail))


def halved(thumbnail: np.ndarray) -> np.ndarray:
    """Halve a thumbnail [P, P, 4] of straight alpha until it is small enough; clear pixels become black."""
    values = thumbnail.astype(np.float64)
    values[..., :3] *= values[..., 3:] / 255
    while len(values) > _THUMBNAIL_PX:
        values = values.reshape(len(values) // 2, 2, -1, 2, 4).mean((1, 3))
    alpha = values[..., 3:]
    values[..., :3] *= 255 / alpha.clip(1)
    return values.round().clip(0, 255).astype(np.uint8)


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description="Write the people who ship.")
    parser.add_argument("folder", type=Path, help="where to write them")
    parser.add_argument("--only", nargs="+", choices=SHIPPED, default=SHIPPED, help="avatars (default: all)")
    args = parser.parse_args()
    for name in args.only:
        write_person(name, args.folder)


if __name__ == "__main__":
    main()
