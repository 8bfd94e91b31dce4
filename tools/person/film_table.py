"""Measure the people of strangers' films: `python -m livehand.tools.person.film_table FOLDER`.

FOLDER holds what `film.py --every 3` and `develop.py --every 3` made of each, in a folder of their name, and in
`stranger2_all` a film of all 72 frames. Each becomes a person, with the hand's true length and nobody telling the angle
of view; the table of docs is written once all are measured. What was measured is kept beside the films.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...backend.avatars.avatar import Avatar
from ...backend.avatars.file import save_avatar
from ...backend.hand.measurements import length_and_breadth_m
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.person.bases import Bases, family_at_base
from ...backend.person.fit.hand_size import sized
from ...backend.person.making import MakingOptions, person_of_pictures
from ...backend.person.person_avatar import person_avatar, shipped_bases
from ...backend.person.sources import PictureSource, pictured_hand
from ...backend.records.hand_picture import HandPicture, PicturedHand
from ...backend.surface.albedo_ratio import RATIO_ARRAY, ratio_steps
from ...backend.surface.atlas_texels import AtlasTexels
from ..results.collect import DATA, ROOT, joined, keep, source
from .gates import Gate, number_gates, picture_gates, pose_gates, pose_in_camera
from .truth import Truth, read_truth

FILM, PERSON, FIGURES = "film.mp4", "person.safetensors", "figures.json"
_WHAT = (
    "`python -m livehand.tools.person.film_table`: 24 frames of a hand that turns for 12 s, by Cycles, with drifting "
    "exposure and white balance; six scenes kept apart"
)
PEOPLE = {
    "insider": "by numbers alone",
    "stranger1": "mottled, tattoo, scars",
    "stranger2": "light, 500 spots",
    "stranger2_all": "the same, 72 frames",
    "stranger3": "deep, 120 spots, scars",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Make and measure the people, and write the table if all were measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the films' folders")
    parser.add_argument("--only", nargs="+", choices=tuple(PEOPLE), default=tuple(PEOPLE), help="(default: all)")
    args = parser.parse_args(arguments)
    origin = source(_WHAT)  # before a long run, in which others may commit
    for name in args.only:
        folder = args.folder / name
        if not (folder / FIGURES).is_file():
            gates = measured(folder, load_default_hand())
            _say("\n".join([name, *(gate.line() for gate in gates)]))
            figures = {"source": origin, "gates": {gate.name: gate.value for gate in gates}}
            (folder / FIGURES).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    paths = {name: args.folder / name / FIGURES for name in PEOPLE}
    if all(path.is_file() for path in paths.values()):
        kept = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in paths.items()}
        table = table_of({name: one["gates"] for name, one in kept.items()})
        of = joined([one["source"] for one in kept.values()])
        keep({"tables": {"people": {"source": of, **table}}}, ROOT / DATA / "from_film.json")


def measured(folder: Path, hand: HandModel) -> list[Gate]:
    """Make the person of a film, kept beside it, and measure all that is known to be true."""
    truth, bases, began_s = read_truth(folder), shipped_bases(hand), time.monotonic()
    avatar, pictured = _made(folder / FILM, hand, bases, float(length_and_breadth_m(hand, truth.beta)[0]))
    seconds = time.monotonic() - began_s
    save_avatar(avatar, folder / PERSON)
    gates = picture_gates(avatar, truth, hand, of_numbers_alone(avatar, bases))
    gates += number_gates(avatar, truth)
    return [*gates, *_of_poses(pictured, truth, hand), Gate("seconds", seconds)]


def _made(film: Path, hand: HandModel, bases: Bases, length_m: float) -> tuple[Avatar, PicturedHand]:
    pictured = sized(pictured_hand(PictureSource(film), hand, _say), hand, length_m)
    made, fitted = person_of_pictures(bases, pictured, MakingOptions(length_m=length_m), _say)
    beta = fitted.pictures[0].pose.beta
    return person_avatar(made, hand, beta, film.parent.name, fitted.side, {"source": fitted.source}), fitted


def of_numbers_alone(avatar: Avatar, bases: Bases) -> Avatar:
    """Return a person as the skin of the family that has their numbers, without anything that pictures showed."""
    assert avatar.surface is not None
    person = avatar.surface.person
    base = next(model for model in bases.models.values() if model.avatar.name == avatar.provenance["base"])
    texels = AtlasTexels.of(base.template.corner_uv, base.template.faces, len(avatar.surface.arrays[RATIO_ARRAY]))
    log_ratio = texels.at_texels(bases.family.log_albedo(person.melanin, person.blood) - family_at_base(base))
    steps = ratio_steps(torch.as_tensor(texels.as_map(log_ratio.astype(np.float32)))).numpy()
    return replace(avatar, surface=replace(avatar.surface, arrays={**avatar.surface.arrays, RATIO_ARRAY: steps}))


def _of_poses(pictured: PicturedHand, truth: Truth, hand: HandModel) -> list[Gate]:
    frames = [round(_seconds(picture) * truth.fps) for picture in pictured.pictures]
    poses = [pose_in_camera(picture.pose, picture.camera, hand) for picture in pictured.pictures]
    return pose_gates(poses, frames, truth, hand)


def _seconds(picture: HandPicture) -> float:
    """Return when a film showed a picture, whose name ends with it."""
    return float(picture.name.rsplit(", ", 1)[1].removesuffix(" s"))


def table_of(figures: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Tabulate the people's gates, by name of the person."""
    of = {name: figures[name] for name in PEOPLE}
    rows = [[label, *(_cell(form, keys, one) for one in of.values())] for label, (form, keys) in _ROWS.items()]
    return {"columns": ["made person", *PEOPLE.values()], "rows": rows}


def _cell(form: str, keys: Sequence[str], figures: Mapping[str, float]) -> str:
    found = [figures[key] for key in keys if key in figures]
    return form.format(*found) if len(found) == len(keys) else ""


def _contrast(side: str) -> tuple[str, tuple[str, ...]]:
    bands = (f"6 contrast, {side} side, {key}" for key in ("l_1_2", "l_2_4", "l_4_8"))
    return "{:.0%} {:.0%} {:.0%}", tuple(bands)


_ROWS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "new poses, views and lights, true shape: PSNR, dB": (
        "{:.1f}",
        ("1 true shape, PSNR dB (3: inside the family 31)",),
    ),
    "FLIP": ("{:.3f}", ("1 true shape, FLIP",)),
    "over numbers alone, worst scene, dB": (
        "{:.1f}",
        ("1 over numbers alone in the worst scene, dB",),
    ),
    "in the shape of the film: PSNR, dB": ("{:.1f}", ("2 own shape, PSNR dB",)),
    "overlap of the outlines (IoU)": ("{:.3f}", ("2 own shape, IoU",)),
    "fingertips, wrist, fingers off by": (
        "{:.1f} mm, {:.1f}, {:.1f} deg",
        ("4 tips, mm", "4 wrist, deg", "4 fingers, deg"),
    ),
    "melanin off by": ("{:.2f}", ("5 melanin, off by",)),
    "contrast at 1-2, 2-4, 4-8 mm where it was seen": _contrast("seen"),
    "where it was not": _contrast("unseen"),
    "tattoo, scars: correlation": ("{:.2f}", ("7 tattoo, correlation",)),
}
"""Of the table: how the named gates are written."""


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
