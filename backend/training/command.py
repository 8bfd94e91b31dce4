"""`livehand train`: arguments, and the call. What needs torch is imported when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING

from ..avatars.library import avatar_path
from ..records.errors import LiveHandError
from ..runtime.command import Command, parse_count
from .config import ReportConfig, TrainConfig

if TYPE_CHECKING:
    import torch

    from ..captures.capture import Capture
    from ..hand.model import HandModel
    from .parts import Correction
    from .processes import Processes
    from .setup import TrainingResult, TrainingSetup

_CONFIGS = ("default", "poseless", "paper")  # the names of `avatar.PRESETS`, which needs torch
_SURFACE_DEVIATION_M = 0.001  # of --refine-surface


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    config = TrainConfig()
    parser.add_argument("capture", type=Path, help="the capture's folder")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="AVATAR", help=".safetensors to write")
    parser.add_argument("--config", choices=_CONFIGS, default="default", help="which networks")
    parser.add_argument("--hand", type=Path, help="the capture's hand model (default: the built-in hand)")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=parse_count, default=config.steps, help="default: %(default)s")
    length.add_argument("--minutes", type=_budget, help="wall-clock time instead of steps")
    parser.add_argument(
        "--batch",
        type=parse_count,
        default=config.batch,
        help="images per step, of all processes (%(default)s)",
    )
    parser.add_argument("--seed", type=int, default=config.seed)
    parser.add_argument("--licence", default=config.licence, help="of the avatar, kept in its header")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint beside the output")
    parser.add_argument(
        "--from",
        dest="origin",
        type=avatar_path,
        metavar="AVATAR",
        help="fine-tune this one, of the same hand and networks",
    )
    parser.add_argument(
        "--ema-decay",
        type=_share,
        default=config.ema_decay,
        help="of the weights' moving average, which is saved; 0: the last step's weights (default: %(default)s)",
    )
    parser.add_argument(
        "--perceptual", type=float, default=config.loss.perceptual, help="weight of the perceptual loss; 0: without it"
    )
    parser.add_argument(
        "--perceptual-weights",
        type=Path,
        metavar="FILE",
        help="VGG19's weights, .safetensors or torchvision's .pth (default: torchvision's cache, then its download)",
    )
    parser.add_argument(
        "--lpips-heads",
        type=Path,
        metavar="FILE",
        help="the LPIPS linear heads of the network in --perceptual-weights: its distance, as in the paper",
    )
    parser.add_argument(
        "--lpips-range",
        choices=("standard", "reference"),
        default="standard",
        help="what LPIPS is fed: [-1, 1], or [0, 1] as the paper's authors did (default: %(default)s)",
    )
    parser.add_argument(
        "--perceptual-region",
        choices=("window", "patch"),
        default=config.loss.perceptual_region,
        help="of the hand: all of it, or one random 64x64 patch, the paper's ablation (default: %(default)s)",
    )
    parser.add_argument(
        "--refine", action="store_true", help="correct training poses and shape along the way; writes AVATAR.refined/"
    )
    parser.add_argument("--refine-surface", action="store_true", help="--refine, and the hand model's surface too")
    parser.add_argument(
        "--camera-colours", action="store_true", help="learn a gain and a bias per camera, for real rigs"
    )
    parser.add_argument(
        "--wear-cameras",
        type=int,
        nargs="+",
        default=[],
        metavar="N",
        help="--camera-colours, and let the avatar look as these cameras see it (default: as the first one does)",
    )
    parser.add_argument(
        "--preview-minutes",
        type=_minutes,
        default=ReportConfig().preview_minutes,
        help="between contact sheets of held-out views, beside the output; 0: none (default: %(default)s)",
    )
    parser.add_argument("--tensorboard", type=Path, metavar="DIR", help="write TensorBoard's event files there")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--precision", choices=("fp32", "bf16"), default="bf16")


def _run(args: argparse.Namespace) -> dict:
    from .processes import joined_processes, process_device

    device = process_device(args.device)
    with joined_processes(device) as processes:
        return _train(args, device, processes)


def _train(args: argparse.Namespace, device: torch.device, processes: Processes) -> dict:
    from .loop import train
    from .step import Machine

    output = _checked_output(args.output)
    reporting = ReportConfig(preview_minutes=args.preview_minutes, tensorboard=args.tensorboard)
    machine = Machine(device, args.precision, processes)
    outcome = train(_task(args, output, device), _config(args), output, machine, reporting, args.resume)
    return _result(output, outcome) if processes.is_first else {}


def _task(args: argparse.Namespace, output: Path, device: torch.device) -> TrainingSetup:
    from ..captures.capture import load_capture
    from ..captures.check import check_capture
    from ..hand.model_file import load_default_hand, load_hand_model
    from ..nerf.avatar import PRESETS
    from .origin import load_origin
    from .perceptual import load_perceptual_loss
    from .setup import TrainingSetup

    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    capture = load_capture(args.capture)
    check_capture(capture, hand)
    origin = load_origin(args.origin) if args.origin else None
    weights = (args.perceptual_weights, args.lpips_heads, args.lpips_range)
    perceptual = load_perceptual_loss(*weights) if args.perceptual > 0 else None
    corrections = _corrections(args, capture, hand, output, device)
    return TrainingSetup(capture, hand, PRESETS[args.config], perceptual, corrections, origin)


def _corrections(
    args: argparse.Namespace, capture: Capture, hand: HandModel, output: Path, device: torch.device
) -> tuple[Correction, ...]:
    from .corrections import camera_colours, refined_poses
    from .refinement import RefinementConfig

    corrections = []
    if args.refine or args.refine_surface:
        config = RefinementConfig(surface_deviation_m=_SURFACE_DEVIATION_M if args.refine_surface else 0.0)
        corrections.append(refined_poses(capture, hand, config, output.with_suffix(".refined"), device))
    if args.camera_colours or args.wear_cameras:
        corrections.append(camera_colours(capture, args.wear_cameras))
    return tuple(corrections)


def _config(args: argparse.Namespace) -> TrainConfig:
    config = TrainConfig(
        steps=args.steps,
        minutes=args.minutes,
        batch=args.batch,
        seed=args.seed,
        ema_decay=args.ema_decay,
        licence=args.licence,
    )
    loss = replace(config.loss, perceptual=args.perceptual, perceptual_region=args.perceptual_region)
    return replace(config, loss=loss)


def _result(output: Path, outcome: TrainingResult) -> dict:
    return {
        "avatar": str(output),
        "steps": outcome.progress.step,
        "skipped_steps": outcome.progress.skipped,
        "minutes": round(outcome.progress.seconds / 60, 2),
        "megabytes": round(output.stat().st_size / 1e6, 2),
        "data_wait_share": round(outcome.data_wait_share, 4),
        "held_out": {name: round(value, 3) for name, value in outcome.held_out.items()},
    }


def _minutes(text: str) -> float:
    return _number(text, lambda value: 0 <= value < inf, "a number of minutes")


def _budget(text: str) -> float:
    return _number(text, lambda value: 0 < value < inf, "a number of minutes above 0")


def _share(text: str) -> float:
    return _number(text, lambda value: 0 <= value < 1, "a number from 0 to below 1")


def _number(text: str, is_allowed: Callable[[float], bool], rule: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not is_allowed(value):
        raise argparse.ArgumentTypeError(f"must be {rule}, got {text!r}")
    return value


def _checked_output(path: Path) -> Path:
    if path.suffix != ".safetensors":
        raise LiveHandError(f"an avatar's file must end in .safetensors, got {path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_suffix(".partial")
        probe.touch()
        probe.unlink(missing_ok=True)  # several processes may do this at once
    except OSError as error:
        raise LiveHandError(f"the avatar's folder {path.parent} must be writable ({error})") from error
    return path


COMMAND = Command("train", "fit an avatar to a capture", _add_arguments, _run)
