"""`livehand compare`: its arguments and its run. Torch is imported only when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...evaluation.lpips_options import add_lpips_arguments, lpips_names, lpips_note, lpips_of
from ...system.command import Command, FailedInPart, parse_count, parse_size_px, say
from ...system.options import number_parser

if TYPE_CHECKING:
    from ...capture.capture import Capture
    from ..baselines.method import Budget, FittingMachine
    from .measures import Measures
    from .rows import Row
    from .run import ComparisonPlan

_TABLES = ("comparison", "canonical", "components", "misfit")
_SPLITS = ("novel_pose", "novel_camera", "test")
_minutes = number_parser("a number of minutes above 0", lambda value: 0 < value < inf)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("capture", type=Path, help="folder of the capture")
    add("-o", "--output", type=Path, metavar="DIR", help="folder of tables, grids and rows; the same one continues")
    add(
        "--tables",
        type=_names_of(_TABLES),
        default=_TABLES[:3],
        metavar="NAME,...",
        help=f"of {', '.join(_TABLES)} (default: all but misfit)",
    )
    add("--rows", nargs="+", metavar="NAME", help="only these rows of the tables")
    add("--list", action="store_true", help="print the rows and their estimated cost, and do nothing")
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--steps", type=parse_count, default=2000, help="for every row (default: %(default)s)")
    budget.add_argument("--core-minutes", type=_minutes, help="processor time for every row instead of steps")
    add("--split", nargs="+", choices=_SPLITS, default=["novel_pose", "test"], help="default: novel_pose test")
    add("--max-images", type=parse_count, default=16, metavar="N", help="of each split (default: %(default)s)")
    add(
        "--speed-size",
        type=parse_size_px,
        default=(334, 512),
        metavar="WxH",
        help="size of the frames that are timed, px (default: 334x512)",
    )
    add("--speed-frames", type=parse_count, default=12, metavar="N", help="timed frames (default: %(default)s)")
    add("--perceptual-weights", type=Path, metavar="FILE", help="VGG19, for the loss and the figures, as in training")
    add("--without-perceptual", action="store_true", help="train and measure without VGG19; some rows stay empty")
    add_lpips_arguments(parser)
    add("--fid-weights", type=Path, metavar="FILE", help="Inception's weights, for FID and KID")
    add(
        "--method",
        action="append",
        default=[],
        metavar="MODULE:NAME",
        help="a method of your own as one more row; repeat for more",
    )
    add("--redo", nargs="+", default=[], metavar="NAME", help="begin these rows again")
    add("--samples", type=parse_count, default=8, metavar="N", help="a ray, of avatars (default: %(default)s)")
    add(
        "--loss",
        choices=("ours", "paper"),
        default="ours",
        help="of avatars: ours, or the paper's, squared error and LPIPS by VGG16 1 : 1 (default: %(default)s)",
    )
    add(
        "--patch-px",
        type=parse_count,
        default=64,
        metavar="N",
        help="side of the patch of row no_sr_patch with --loss paper (default: %(default)s)",
    )
    add("--inference-only", action="store_true", help="row hierarchical: take the networks of row paper, train nothing")
    add("--seed", type=int, default=0, help="of weights, order and samples (default: %(default)s)")
    add("--hand", type=Path, help="hand model of the capture (default: the built-in one it shows)")
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help="default: %(default)s")
    add("--precision", choices=("fp32", "bf16"), default="bf16", help="of training (default: %(default)s)")


def _run(args: argparse.Namespace) -> Mapping[str, Any]:
    from ...capture.capture import load_capture
    from ..baselines.method import Budget
    from .rows import AvatarSettings, chosen_rows, load_own_method

    capture = load_capture(args.capture)
    own = [load_own_method(text) for text in args.method]
    avatars = AvatarSettings(args.samples, args.loss == "paper", args.patch_px)
    rows = chosen_rows(args.tables, args.rows, own, avatars)
    budget = Budget(args.steps, args.core_minutes)
    if args.list:
        return _listed(rows, budget, capture)
    every = chosen_rows(args.tables, None, own, avatars)
    return _compared(args, every, tuple(row.name for row in rows), budget, capture)


def _listed(rows: list[Row], budget: Budget, capture: Capture) -> dict[str, Any]:
    costs = {row.name: row.core_minutes(budget, capture) for row in rows}
    ordered = sorted(rows, key=lambda row: costs[row.name])
    lines = [f"{row.name:24} {costs[row.name]:8.1f}  {', '.join(row.tables):40} {row.label}" for row in ordered]
    total = sum(costs.values())
    text = "\n".join([f"{'row':24} core-min  tables", *lines, f"{'together':24} {total:8.1f}"])
    return {"rows": costs, "core_minutes": total, "summary": text}


def _compared(
    args: argparse.Namespace, rows: list[Row], wanted: tuple[str, ...], budget: Budget, capture: Capture
) -> dict[str, Any]:
    from ...capture.check import check_capture
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from ...records.errors import LiveHandError
    from .run import Comparison

    if args.output is None:
        raise LiveHandError("a comparison needs a folder for its results; give it with -o DIR, or ask with --list")
    hand = load_hand_model(args.hand or DEFAULT_HAND)
    check_capture(capture, hand)
    machine, measures = _machine_and_measures(args)
    plan = _plan(args, rows, wanted, budget, machine)
    comparison = Comparison(plan, capture, hand, args.output, machine, measures, say)
    page = comparison.run()
    result = {
        "folder": str(args.output),
        "rows": len({line.name for table in page.tables for line in table.lines}),
        "missing": comparison.remarks,
        "summary": "\n".join([page.markdown(), *comparison.remarks]),
    }
    if comparison.remarks:
        raise FailedInPart(result)
    return result


def _machine_and_measures(args: argparse.Namespace) -> tuple[FittingMachine, Measures]:
    from ...evaluation.perceptual.fetched import fetched_lpips
    from ...evaluation.perceptual.vgg import load_vgg_distance
    from ...render.device import torch_device
    from ...training.processes import ComputeSetup
    from ..baselines.method import FittingMachine
    from .measures import Measures

    device = torch_device(args.device)
    vgg19 = None if args.without_perceptual else load_vgg_distance(args.perceptual_weights).to(device)
    of_loss = args.perceptual_weights or (None if vgg19 is None else Path("vgg19-dcbb9e9d.pth"))
    names = [*([of_loss.name] if of_loss else []), *lpips_names(args)]
    names += [args.fid_weights.name] if args.fid_weights else []
    compute = ComputeSetup(device, args.precision)
    of_training = fetched_lpips("vgg16").to(device) if args.loss == "paper" else vgg19
    machine = FittingMachine(compute, of_training, args.seed, args.inference_only)
    return machine, Measures.of(vgg19, lpips_of(args, device), args.fid_weights, device, names)


def _plan(
    args: argparse.Namespace, rows: list[Row], wanted: tuple[str, ...], budget: Budget, machine: FittingMachine
) -> ComparisonPlan:
    from ..benchmark.machine import describe
    from .run import ComparisonPlan
    from .speed import SpeedPlan

    known = describe(machine.device)
    gpu = f", {known['gpu']}" if known["gpu"] else ""
    named = f"{known['cpu']}, {known['threads']} of {known['cores']} cores{gpu}"
    facts = ("machine", named), ("torch", str(known["torch"])), ("samples a ray", str(args.samples))
    if note := lpips_note(args):
        facts = *facts, ("not measured", note)
    speed = SpeedPlan(args.speed_size, args.speed_frames)
    splits, redo = tuple(args.split), tuple(args.redo)
    return ComparisonPlan(tuple(rows), wanted, budget, splits, args.max_images, speed, redo, facts)


def _names_of(known: tuple[str, ...]) -> Callable[[str], tuple[str, ...]]:
    def parse(text: str) -> tuple[str, ...]:
        names = tuple(name.strip() for name in text.split(","))
        unknown = [name for name in names if name not in known]
        if unknown:
            raise argparse.ArgumentTypeError(f"must be of {', '.join(known)}, got {unknown[0]!r}")
        return names

    return parse


COMMAND = Command(
    "compare", "make the paper's tables for a capture: every method and every choice", _add_arguments, _run
)
