"""Writes the records of the people who ship as numbers (`backend/avatars/drawn_people.py`), with small thumbnails.

python -m livehand.tools.avatars.people FOLDER
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...backend.avatars.file import write_record
from ...backend.avatars.library import PERSONS, Shipped
from ...backend.person.invented.command import new_person
from ...backend.surface.people.look import PersonLook
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


def write_people(folder: Path) -> None:
    """Write a record for each of them; some 25 s each."""
    for name, (seed, numbers) in PEOPLE.items():
        look = PersonLook.of(seed, numbers)
        avatar = new_person(look, PERSONS[name], lambda line: None)
        assert avatar.thumbnail is not None
        write_record(replace(avatar, thumbnail=halved(avatar.thumbnail)), look, folder / f"{name}.safetensors")
        warn(f"{name}: {look.facts()}")


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
    """Write the records."""
    parser = argparse.ArgumentParser(description="Write the records of the people who ship as numbers.")
    parser.add_argument("folder", type=Path, help="where to write them")
    write_people(parser.parse_args().folder)


if __name__ == "__main__":
    main()
