"""`livehand evaluate`: its arguments and its run. Torch is imported only when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..avatars.library import AVATAR_HELP, avatar_path, shipped_avatar_path
from ..records.errors import LiveHandError
from ..system.command import Command, parse_count
from .lpips_options import add_lpips_arguments, lpips_names, lpips_note, lpips_of

if TYPE_CHECKING:
    import torch

    from ..avatars.avatar import Avatar
    from ..capture.capture import Capture, CaptureView
    from .distances import Distance
    from .evaluate import ViewScore
    from .report import Summary

_SHEET_VIEWS = 24
_SEVERAL = ("held_out", "all")  # names of several splits together
_LEFT_OUT = "they do not show the hand, no light reaches what they show, or --max-train-view-angle is less than theirs"
_OTHER_SKIN = (
    "the capture shows another skin or surface than the avatar's, which the figures count, too; to measure the avatar "
    "alone, capture its own: livehand capture --person AVATAR"
)
_NO_FLIP = 'FLIP was not measured: it needs the package flip-evaluator; pip install "livehand[metrics]"'


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", type=Path, help="the capture's folder")
    parser.add_argument(
        "--avatar", type=avatar_path, default=shipped_avatar_path(), metavar="NAME|FILE", help=AVATAR_HELP
    )
    parser.add_argument("--identity", metavar="NAME", help="of an avatar of several people: whom, or `mean` of them")
    parser.add_argument("--hand", type=Path, help="the avatar's hand model (default: its built-in one)")
    parser.add_argument(
        "--split",
        choices=("test", "novel_pose", "novel_camera", "novel_light", "train", *_SEVERAL),
        default="test",
        help="test: held-out poses from held-out cameras (default); held_out: each split except train; all: each split",
    )
    parser.add_argument(
        "--max-train-view-angle",
        "--max-camera-gap",
        type=_degrees,
        metavar="DEG",
        help="only views whose camera, seen from the hand, is within this angle of a training camera",
    )
    parser.add_argument(
        "--max-images", type=parse_count, metavar="N", help="at most N views of each split, evenly spaced"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder for scores.csv, the summaries and the contact sheets"
    )
    parser.add_argument(
        "--worst", type=parse_count, default=8, metavar="K", help="number of views in worst.png (default: %(default)s)"
    )
    add_lpips_arguments(parser)
    parser.add_argument(
        "--perceptual-weights",
        type=Path,
        metavar="FILE",
        help="measure the VGG19 distance of training, which is not LPIPS",
    )
    parser.add_argument(
        "--contrast",
        action="store_true",
        help="measure how much L* varies in bands of 1 to 16 mm on the hand, in the truth and in the render",
    )
    parser.add_argument(
        "--without-skin-detail",
        action="store_true",
        help="measure what the avatar learnt alone, without the known fine detail of its skin",
    )
    parser.add_argument("--record", action="store_true", help="write the results into the avatar's metadata")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda", "mps"), default="auto")
    parser.add_argument("--precision", choices=("fp32", "bf16"), default="fp32")


def _run(args: argparse.Namespace) -> dict:
    from ..avatars.file import check_keeps_networks, load_avatar
    from ..avatars.identities import of_identity
    from ..capture.capture import load_capture
    from ..hand.model_file import DEFAULT_HAND, load_hand_model
    from ..render.renderer import Renderer
    from .evaluate import check_any, scored_views, shows_other_skin
    from .report import by_light, by_split, summary, summary_tables
    from .sheets import SheetViews

    if args.identity and args.record:
        raise LiveHandError("--record is of a whole avatar, got --identity; leave one of them out")
    if args.record:
        check_keeps_networks(args.avatar)
    avatar = load_avatar(args.avatar)
    if args.identity:
        avatar = of_identity(avatar, args.identity)
    hand = load_hand_model(args.hand or DEFAULT_HAND)
    has_detail = not args.without_skin_detail
    renderer = Renderer(avatar, hand, args.device, args.precision, has_skin_detail=has_detail)
    capture = load_capture(args.capture)
    views = _views_of(capture, args.split, args.max_images)
    sheets = SheetViews(len(views), *((_SHEET_VIEWS, args.worst) if args.output else (0, 0)))
    distances = _distances(args, renderer.torch_device)
    measured = scored_views(renderer, capture, views, distances, args.max_train_view_angle, args.contrast)
    scores = [view.score for view in sheets.watch(measured)]
    check_any(scores, capture)
    total, splits, lights = summary(scores), by_split(scores), by_light(scores)
    lines = {**lights, **(splits if args.split in _SEVERAL else {}), args.split: total}
    is_other = shows_other_skin(capture, renderer.avatar)
    text = "\n".join([summary_tables(lines), *_notes(total, len(views), is_other, lpips_note(args))])
    if args.output:
        _write_results(args, scores, (total, splits, lights), text)
        sheets.save(args.output)
    if args.record:
        _record(renderer.avatar, {**splits, **lights}, args.avatar)
    return {**total, "summary": text}


def _record(avatar: Avatar, summaries: dict[str, Summary], path: Path) -> None:
    from ..avatars.file import save_avatar

    save_avatar(replace(avatar, metrics={**avatar.metrics, **summaries}), path)


def _views_of(capture: Capture, split: str, most: int | None) -> list[CaptureView]:
    from .evaluate import spaced_views

    present = {view.split for view in capture.views}
    names = sorted(present - {"train"} if split == "held_out" else present) if split in _SEVERAL else [split]
    return [view for name in names for view in spaced_views(capture.of_split(name), most)]  # type: ignore[arg-type]


def _distances(args: argparse.Namespace, device: torch.device) -> list[Distance]:
    from .distances import vgg19_distance

    found = [vgg19_distance(args.perceptual_weights, device)] if args.perceptual_weights else []
    return found + lpips_of(args, device)


def _notes(total: Summary, view_count: int, is_other: bool, lpips: str | None) -> list[str]:
    """Word what the tables do not tell."""
    left_out = view_count - int(total["images"])
    notes = [f"{left_out} of {view_count} views were left out: {_LEFT_OUT}"] if left_out else []
    notes += [_OTHER_SKIN] if is_other else []
    notes += [] if "flip" in total else [_NO_FLIP]
    notes += [lpips] if lpips else []
    return ["", *notes] if notes else []


def _write_results(
    args: argparse.Namespace,
    scores: list[ViewScore],
    figures: tuple[Summary, dict[str, Summary], dict[str, Summary]],
    text: str,
) -> None:
    from .report import scores_csv, summary_json, write_text

    facts = {"capture": str(args.capture), "avatar": str(args.avatar), "split": args.split}
    if names := lpips_names(args):
        facts["lpips_weights"] = ", ".join(names)
    write_text(scores_csv(scores), args.output / "scores.csv")
    write_text(summary_json(facts, *figures), args.output / "summary.json")
    write_text(text + "\n", args.output / "summary.txt")


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 180:
        raise argparse.ArgumentTypeError(f"must be degrees from 0 to 180, got {text!r}")
    return value


COMMAND = Command("evaluate", "measure an avatar against a capture's held-out views", _add_arguments, _run)
