"""`livehand evaluate`: arguments, and the call. What needs torch is imported when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..command import Command

if TYPE_CHECKING:
    from ..avatar import Avatar
    from ..capture import Capture, CaptureView
    from .evaluate import ViewScore

_SHEET_VIEWS = 24
_COLUMNS = ("psnr_full", "psnr_hand", "ssim", "alpha_iou")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", type=Path, help="the capture's folder")
    parser.add_argument("--avatar", type=Path, help="an avatar file (default: the shipped one)")
    parser.add_argument("--hand", type=Path, help="the avatar's hand model (default: the built-in hand)")
    parser.add_argument(
        "--split",
        choices=("test", "novel_pose", "novel_camera", "train", "all"),
        default="test",
        help="test: held-out poses from held-out cameras (default); all: every split, a figure for each",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder for contact_sheet.png and scores.csv")
    parser.add_argument("--record", action="store_true", help="write the figures into the avatar's own header")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--precision", choices=("fp32", "bf16"), default="fp32")


def _run(args: argparse.Namespace) -> dict:
    from ..avatar import load_avatar, shipped_avatar_path
    from ..capture import load_capture
    from ..hand.model import load_default_hand, load_hand_model
    from ..renderer import Renderer
    from .evaluate import score_views, summary

    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    renderer = Renderer(load_avatar(args.avatar), hand, args.device, args.precision)
    capture = load_capture(args.capture)
    scores = score_views(renderer, capture, _views_of(capture, args.split))
    if args.output:
        _write_results(scores, args.output)
    by_split = {split: summary([s for s in scores if s.split == split]) for split in sorted({s.split for s in scores})}
    if args.record:
        _record(renderer.avatar, by_split, args.avatar or shipped_avatar_path())
    result = summary(scores)
    lines = by_split if args.split == "all" else {}
    table = "".join(_line(name, figures) + "\n" for name, figures in lines.items())
    return {**result, "summary": table + _line(args.split, result)}


def _record(avatar: Avatar, by_split: dict[str, dict[str, float | int]], path: Path) -> None:
    from ..avatar import save_avatar

    save_avatar(replace(avatar, metrics={**avatar.metrics, **by_split}), path)


def _views_of(capture: Capture, split: str) -> tuple[CaptureView, ...]:
    return capture.views if split == "all" else capture.of_split(split)  # type: ignore[arg-type]


def _line(name: str, figures: dict[str, float | int]) -> str:
    return (
        f"{name:13s} {figures['images']:5d} images  PSNR {figures['psnr_full']:.2f} dB full, "
        f"{figures['psnr_hand']:.2f} dB hand  SSIM {figures['ssim']:.4f}  alpha IoU {figures['alpha_iou']:.4f}"
    )


def _write_results(scores: list[ViewScore], folder: Path) -> None:
    from .contact_sheet import comparison_sheet, save_sheet

    shown = scores[:: max(1, len(scores) // _SHEET_VIEWS)][:_SHEET_VIEWS]
    save_sheet(comparison_sheet([(score.truth, score.image) for score in shown]), folder / "contact_sheet.png")
    with (folder / "scores.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("file", "split", *_COLUMNS))
        writer.writerows((s.file, s.split, *(f"{getattr(s, name):.4f}" for name in _COLUMNS)) for s in scores)


COMMAND = Command("evaluate", "measure an avatar against a capture's held-out views", _add_arguments, _run)
