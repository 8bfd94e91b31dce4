"""The paper's central claim, decided: `python -m livehand.tools.paper.claim FOLDER --vgg19 FILE`.

What is there is kept. An invented person, whose surface nobody is given, is seen in close-ups of 6 cm on 48 pixels,
as fine as the paper's pictures. One network learns them without, with and with a patch-wise perceptual loss.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import comb
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from PIL import Image

from ...backend.avatars.avatar import AvatarConfig
from ...backend.avatars.file import load_avatar
from ...backend.hand.model_file import load_default_hand
from ...backend.image.superres import SuperResConfig
from ...backend.render.renderer import Renderer
from ...backend.research.baselines.avatar_rows import AvatarRow
from ...backend.research.comparison.grid import load_pictures
from ...backend.research.rendered_capture import CloseUps, render_capture
from ...backend.training.config import PAPER, LossConfig
from ...livehand_blender.cli import main as livehand
from ..results.collect import DATA, ROOT, keep, source

_PATCH_PX = 32
_FULL = PAPER.loss
_NONE = replace(_FULL, perceptual=0.0)
_PATCH = replace(_FULL, perceptual_region="patch", perceptual_patch_px=_PATCH_PX)
_WITHOUT_SR = replace(AvatarConfig(), superres=SuperResConfig(kind="none"))


def _row(name: str, label: str, config: AvatarConfig, loss: LossConfig) -> AvatarRow:
    return AvatarRow(name, label, ("components",), "Our default's networks, the paper's loss.", config, loss)


NONE = _row("planes_none", "planes, no perceptual loss", AvatarConfig(), _NONE)
PATCH = _row("planes_patch", "planes, perceptual loss on patches", AvatarConfig(), _PATCH)
FULL = _row("planes_full", "planes, perceptual loss on the full image", AvatarConfig(), _FULL)
SHARP_NONE = _row("planes_no_sr_none", "planes without SR, no perceptual loss", _WITHOUT_SR, replace(_NONE, low_l2=0.0))
SHARP_FULL = _row("planes_no_sr_full", "planes without SR, perceptual, full", _WITHOUT_SR, replace(_FULL, low_l2=0.0))

SEEDS = (0, 1, 2)
PERSON = {"seed": 55, "age": 60, "tone": 0.35, "freckles": 1.5, "folds": 1.5, "veins": 0.5, "hair": 0}
ROWS = {
    "planes_none": "NONE",
    "planes_full": "FULL",
    "planes_patch": "PATCH",
    "planes_no_sr_none": "SHARP_NONE",
    "planes_no_sr_full": "SHARP_FULL",
}
"""Names of the rows, and of their methods in this module."""
PAIRS = {"planes_full": "planes_none", "planes_patch": "planes_none", "planes_no_sr_full": "planes_no_sr_none"}
"""Rows with the perceptual loss, and what each is compared with."""
_FIGURES = {"psnr_hand": "PSNR hand", "ssim": "SSIM", "lpips": "LPIPS", "vgg19_frechet": "vgg19_frechet"}
_SHOWN_PX = 144

Scores = Mapping[tuple[str, int], Mapping[str, Mapping[str, float]]]
"""Of a row and a seed: by a view's file, its figures."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, compare, and write figures and pictures of the rows that are there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps person, capture and rows")
    parser.add_argument("--vgg19", type=Path, required=True, help="weights of the features for the Frechet distance")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=tuple(ROWS), help="default: all")
    parser.add_argument("--steps", type=int, default=500, help="of each row (default: 500)")
    parser.add_argument("--gather", action="store_true", help="train nothing: of what is there")
    args = parser.parse_args(arguments)
    if not args.gather:
        _train(args)
    document = gathered(args.folder, args.rows, args.steps)
    keep(document, ROOT / DATA / "claim.json")
    _grid(args.folder, args.rows).save(ROOT / "docs/images/claim.png")
    sys.stdout.write(json.dumps(document["tests"], indent=1) + "\n")


def _train(args: argparse.Namespace) -> None:
    capture = args.folder / "capture"
    if not (capture / "transforms.json").is_file():
        hand, path = load_default_hand(), args.folder / "person.safetensors"
        numbers = [word for name, value in PERSON.items() for word in (f"--{name}", value)]
        if not path.is_file():
            _run("new-person", "-o", path, *numbers)
        plan = CloseUps(size_px=48, field_m=0.06, seed=3)
        made = plan.make(capture, hand, {"made_by": "livehand.tools.paper.claim", "person": PERSON})
        render_capture(made, Renderer(load_avatar(path), hand, "cpu"))
    methods = [word for name in ROWS.values() for word in ("--method", f"livehand.tools.paper.claim:{name}")]
    options = ["--tables", "components", "--loss", "paper", "--steps", args.steps, "--max-images", 12]
    options += ["--split", "novel_pose", "novel_camera", "test", "--perceptual-weights", args.vgg19]
    options += ["--speed-size", "48x48", "--speed-frames", 2, "--rows", *args.rows]
    for seed in SEEDS:
        _run("compare", capture, "-o", args.folder / f"seed{seed}", *methods, *options, "--seed", seed)


def _run(*words: object) -> None:
    if livehand([str(word) for word in words]):
        raise SystemExit(1)


def gathered(folder: Path, rows: Sequence[str], steps: int) -> dict[str, Any]:
    """Collect the figures of all rows and seeds, and test the rows with a perceptual loss against those without."""
    scores = {(row, seed): _scores(_row_folder(folder, row, seed) / "scores.csv") for row in rows for seed in SEEDS}
    table = [[f"`{row}`", *(_spread(folder, scores, row, name) for name in _FIGURES)] for row in rows]
    tests = {row: sign_test(scores, row, plain) for row, plain in PAIRS.items() if row in rows and plain in rows}
    made = source("`python -m livehand.tools.paper.claim`")
    seeds = f"{len(SEEDS)} seeds, {steps} steps; least to most of the seeds"
    columns = ["row", *_FIGURES.values()]
    of_page = {"columns": columns, "rows": table, "source": {**made, "what": f"{made['what']}: {seeds}"}}
    return {"tables": {"rows": of_page}, "tests": tests, "source": made}


def sign_test(scores: Scores, row: str, plain: str, figure: str = "lpips") -> dict[str, float]:
    """Count the views, and the pairs of view and seed, in which a row has the lower figure.

    Returns:
        `views` and `pairs` of them, `lower_views` and `lower_pairs`, and `p` of the views, two-sided: a view's figure
        is the mean over its seeds, as pairs of one view are not independent.
    """
    files = sorted(scores[row, SEEDS[0]])
    gaps = np.array([[scores[row, seed][f][figure] - scores[plain, seed][f][figure] for f in files] for seed in SEEDS])
    lower = int((gaps.mean(0) < 0).sum())
    return {
        "views": len(files),
        "lower_views": lower,
        "p": two_sided(lower, len(files)),
        "pairs": gaps.size,
        "lower_pairs": int((gaps < 0).sum()),
        "mean_gap": round(float(gaps.mean()), 4),
    }


def two_sided(lower: int, count: int) -> float:
    """Compute the probability that a fair coin falls at least as unevenly."""
    tail = min(lower, count - lower)
    return min(1.0, 2 * sum(comb(count, k) for k in range(tail + 1)) / 2**count)


def _row_folder(folder: Path, row: str, seed: int) -> Path:
    return folder / f"seed{seed}" / "rows" / row


def _scores(path: Path) -> dict[str, dict[str, float]]:
    with path.open(newline="") as file:
        return {
            line["file"]: {name: float(line[name]) for name in _FIGURES if name in line}
            for line in csv.DictReader(file)
        }


def _spread(folder: Path, scores: Scores, row: str, name: str) -> str:
    """Write the mean over all views of each seed, the least and the most."""
    values = []
    for seed in SEEDS:
        if name in next(iter(scores[row, seed].values())):
            values.append(fmean(view[name] for view in scores[row, seed].values()))
        else:
            summaries = json.loads((_row_folder(folder, row, seed) / "summary.json").read_text())[""]
            values.append(fmean(summary[name] for summary in summaries.values()))
    digits = 4 if max(values) < 1 else 1
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _grid(folder: Path, rows: Sequence[str]) -> Image.Image:
    """Set the truth above each row's pictures of the same held-out views."""
    pairs = {row: load_pictures(_row_folder(folder, row, SEEDS[0]) / "pictures.npz") for row in rows}
    strips = [
        [truth for truth, _ in next(iter(pairs.values()))],
        *([image for _, image in of] for of in pairs.values()),
    ]
    return Image.fromarray(np.concatenate([np.concatenate([_enlarged(one) for one in strip], 1) for strip in strips]))


def _enlarged(picture: np.ndarray) -> np.ndarray:
    pixels = Image.fromarray((picture[..., :3].clip(0, 1) * 255 + 0.5).astype(np.uint8))
    return np.asarray(pixels.resize((_SHOWN_PX, _SHOWN_PX), Image.Resampling.NEAREST))


if __name__ == "__main__":
    main()
