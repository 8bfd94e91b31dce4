"""Several people in one network: `python -m livehand.tools.paper.people FOLDER`; what is there already is kept.

The three who ship and three invented ones train one network of the paper's, with a code for each, on frames of their
avatars; one more invented person is fitted by a code alone. Measured is the PSNR on the hand in held-out poses.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from ...backend.avatars.avatar import Avatar
from ...backend.avatars.file import load_avatar
from ...backend.avatars.identities import MEAN, identity_names, of_identity
from ...backend.avatars.library import SKINS, shipped_avatar_path
from ...backend.capture.capture import Capture, load_capture
from ...backend.evaluation.evaluate import scored_views
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.render.renderer import Renderer
from ...backend.research.rendered_capture import CloseUps, render_capture
from ...livehand_blender.cli import main as livehand
from ..results.collect import DATA, ROOT, keep, source

_INVENTED = {f"invented {seed}": ("--seed", str(seed)) for seed in (1, 2, 3)}
_NEW_NAME = "new"
_NEW = {_NEW_NAME: tuple("--seed 55 --age 60 --tone 0.35 --freckles 1.5 --folds 1.5 --veins 0.5 --hair 0".split())}
_STEPS = 3000
_SOURCE = f"`python -m livehand.tools.paper.people`: hand, dB, held-out poses, 64x64; {_STEPS:,} steps"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, measure, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps avatars, captures and networks")
    folder = parser.parse_args(arguments).folder
    hand = load_default_hand()
    captures = {name: _capture(name, folder, hand) for name in (*SKINS, *_INVENTED, *_NEW)}
    together, fitted = _trained(folder, captures), folder / "fitted.safetensors"
    if not fitted.is_file():
        _run("identity", together, "--name", _NEW_NAME, "--fit", captures[_NEW_NAME].folder, "-o", fitted)
    table = _table(load_avatar(together), load_avatar(fitted), captures, hand)
    keep({"tables": {"people": table}}, ROOT / DATA / "identities.json")
    sys.stdout.write(json.dumps(table, indent=1) + "\n")


def _capture(name: str, folder: Path, hand: HandModel) -> Capture:
    """Load a person's capture, or make it of their avatar's frames, and if need be the person."""
    place = folder / "captures" / name
    if (place / "transforms.json").is_file():
        return load_capture(place)
    path = shipped_avatar_path(name) if name in SKINS else folder / f"{name}.safetensors"
    if not path.is_file():
        _run("new-person", "-o", path, *({**_INVENTED, **_NEW}[name]))
    avatar = load_avatar(path)
    beta = (0.0,) * 10 if avatar.surface is None else tuple(map(float, avatar.surface.person.beta))
    plan = CloseUps(poses=12, directions=8, field_m=0.2, size_px=64, seed=7, beta=beta)
    return render_capture(plan.make(place, hand, {"person": name}), Renderer(avatar, hand, "cpu"))


def _trained(folder: Path, captures: Mapping[str, Capture]) -> Path:
    path, names = folder / "together.safetensors", (*SKINS, *_INVENTED)
    if not path.is_file():
        options = ("--config", "paper", "--perceptual", 0, "--steps", _STEPS, "--preview-minutes", 0, "--resume")
        folders = (captures[name].folder for name in names)
        _run("train", *folders, "--identities", *names, "-o", path, *options)
    return path


def _run(*words: object) -> None:
    if livehand([str(word) for word in words]):
        raise SystemExit(1)


def _table(together: Avatar, fitted: Avatar, captures: Mapping[str, Capture], hand: HandModel) -> dict[str, Any]:
    """Measure each person with their own code, the mean of all, and the best of the others', dB."""
    names, rows = identity_names(together), []
    for name, capture in captures.items():
        found = {code: _psnr_db(together, code, capture, hand) for code in (*names, MEAN)}
        own = found[name] if name in found else _psnr_db(fitted, name, capture, hand)
        best = max(found[code] for code in names if code != name)
        label = f"{name}, by a code alone" if name == _NEW_NAME else name
        rows.append([label, *(f"{db:.1f}" for db in (own, found[MEAN], best))])
    columns = ["person", "own code", "mean code", "best other code"]
    return {"columns": columns, "rows": rows, "source": source(_SOURCE)}


def _psnr_db(avatar: Avatar, name: str, capture: Capture, hand: HandModel) -> float:
    renderer = Renderer(of_identity(avatar, name), hand, "cpu")
    views = capture.of_split("novel_pose") + capture.of_split("test")
    return fmean(scored.score.figures["psnr_hand"] for scored in scored_views(renderer, capture, views))


if __name__ == "__main__":
    main()
