"""The people that ship against Cycles, in poses, views and lights that no training saw.

`python -m livehand.tools.results.against_cycles FOLDER` renders each person in the surface and the albedo of their
avatar, measures the avatar on the pictures, and writes the tables once all people are there. What is in the folder is
kept.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import torch

from ...backend.avatars.file import load_avatar
from ...backend.avatars.library import PERSONS, SHIPPED, Shipped, shipped_avatar_path
from ...backend.avatars.worn_textures import worn_textures
from ...backend.capture.plan import CapturePlan
from ...backend.capture.varied_light import HELD_OUT_KINDS
from ...backend.evaluation.distances import fetched_lpips_distances
from ...backend.evaluation.evaluate import scored_views
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.render.renderer import Renderer
from ...livehand_blender.capture.dressed_hand import DressedHand
from ...livehand_blender.capture.render import render_capture
from .collect import DATA, ROOT, joined, keep, source

_DOCUMENT = DATA / "against_cycles.json"
_FIRST_SEED = 700
_PLAN = CapturePlan(poses=44, lights="varied")
_FIGURES = ("psnr_hand", "psnr_full", "ssim_hand", "flip", "lpips")
_WHAT = (
    "`python -m livehand.tools.results.against_cycles`: each avatar that ships on views of its own person by Cycles, "
    f"64 samples, seeds from {_FIRST_SEED}; in brackets the views"
)


class MeasuredView(NamedTuple):
    """What a view of a person gave: the kind of its light, whether it is a close-up, and `_FIGURES` by name."""

    person: str
    kind: str
    is_close: bool
    figures: Mapping[str, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Render and measure the people that are named, and write the tables if all were measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps captures and figures")
    parser.add_argument("--only", nargs="+", choices=SHIPPED, default=SHIPPED, help="avatars (default: all)")
    parser.add_argument("--threads", type=int, help="of Cycles (default: all)")
    parser.add_argument("--views", type=int, default=2, metavar="N", help="of each person in each kind of light")
    args = parser.parse_args(arguments)
    hand, origin = load_default_hand(), source(_WHAT)  # before a long run, in which others may commit
    for name in args.only:
        path = _figures_path(args.folder, name)
        if not path.is_file():
            plan = replace(_PLAN, eval_views=2 * args.views)  # half as many of a kind
            found = _measured(name, hand, plan, args.folder / name, args.threads)
            kept = {"source": origin, "views": [view._asdict() for view in found]}
            path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    paths = [_figures_path(args.folder, name) for name in SHIPPED]
    if all(path.is_file() for path in paths):
        of_people = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
        views = [MeasuredView(**row) for one in of_people for row in one["views"]]
        keep({"tables": tables_of(views, joined([one["source"] for one in of_people]))}, ROOT / _DOCUMENT)
        sys.stdout.write(f"written: {_DOCUMENT}\n")


def _figures_path(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def _measured(
    name: Shipped, hand: HandModel, plan: CapturePlan, folder: Path, threads: int | None
) -> list[MeasuredView]:
    avatar, seed = load_avatar(shipped_avatar_path(name)), _FIRST_SEED + SHIPPED.index(name)
    assert avatar.surface is not None
    subject = DressedHand(hand, worn_textures(avatar, hand))
    plan = replace(plan, person=avatar.surface.person, seed=seed)
    capture = render_capture(folder, plan, {"plan": plan.facts()}, threads, subject, "test")
    lpips = fetched_lpips_distances("alexnet", torch.device("cpu"))[:1]
    scored = [view.score for view in scored_views(Renderer(avatar, hand, "cpu"), capture, capture.views, lpips)]
    return [
        MeasuredView(
            name, str(one.light_kind), plan.is_close_up(one.camera_index), {key: one.figures[key] for key in _FIGURES}
        )
        for one in scored
    ]


def tables_of(views: Sequence[MeasuredView], of: Mapping[str, str]) -> dict[str, Any]:
    """Tabulate the views by the kind of light, and by person."""
    shown = {"source": of}
    by_light = [[kind, *_pair([view for view in views if view.kind == kind])] for kind in sorted_kinds(views)]
    by_light.append(["all", *_pair(views)])
    people: list[Shipped] = [name for name in SHIPPED if any(view.person == name for view in views)]
    by_person = [_person_row(name, [view for view in views if view.person == name]) for name in people]
    return {
        "psnr": {**shown, "columns": ["hand, dB", "whole", "close-up"], "rows": by_light},
        "people": {**shown, "columns": _PERSON_COLUMNS, "rows": by_person},
    }


_PERSON_COLUMNS = ["person", "whole: hand, dB", "close-up: hand, dB", "image, dB", "SSIM of the hand", "FLIP", "LPIPS"]


def sorted_kinds(views: Sequence[MeasuredView]) -> list[str]:
    """Return the kinds of light that there are, as captures order them."""
    return [kind for kind in HELD_OUT_KINDS if any(view.kind == kind for view in views)]


def _person_row(name: Shipped, views: Sequence[MeasuredView]) -> list[str]:
    formats: dict[str, Callable[[float], str]] = {
        "psnr_full": "{:.1f}".format,
        "ssim_hand": "{:.3f}".format,
        "flip": "{:.3f}".format,
        "lpips": "{:.3f}".format,
    }
    means = (form(fmean(view.figures[key] for view in views)) for key, form in formats.items())
    return [PERSONS[name], *_pair(views), *means]


def _pair(views: Sequence[MeasuredView]) -> list[str]:
    """Return the mean PSNR on the hand of whole hands and of close-ups."""
    return [_mean([view for view in views if view.is_close == is_close]) for is_close in (False, True)]


def _mean(views: Sequence[MeasuredView]) -> str:
    return f"{fmean(view.figures['psnr_hand'] for view in views):.1f} ({len(views)})" if views else "-"


if __name__ == "__main__":
    main()
