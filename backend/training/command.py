"""`livehand train`: arguments and call. Modules that need torch are imported when it runs, which keeps --help fast."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..avatars.library import avatar_path
from ..records.errors import LiveHandError
from ..system.command import Command, warn
from ..system.options import add_options, from_options
from .config import PAPER, PAPER_CAMERA_RATE, LossConfig, ReportConfig, TrainConfig

if TYPE_CHECKING:
    import torch

    from ..avatars.avatar import Avatar
    from ..capture.capture import Capture
    from ..hand.model import HandModel
    from .losses import PerceptualDistance
    from .parts import Correction
    from .processes import Processes
    from .setup import TrainingResult, TrainingSetup

PRESET_NAMES = ("default", "relightable", "poseless", "paper")
"""The names in `avatars.avatar.PRESETS`, which needs torch."""
_SURFACE_DEVIATION_M = 0.001  # with --refine-surface
_HELD_OUT_VIEWS = 12  # by which a person's training is measured
_FEW_STEPS = 1000  # below which a budget of time was too small


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "captures",
        type=Path,
        nargs="+",
        metavar="capture",
        help="folder of the capture; of several, one a person: one network with a code for each of them",
    )
    add("-o", "--output", type=Path, required=True, metavar="AVATAR", help=".safetensors file to write")
    add(
        "--config",
        choices=PRESET_NAMES,
        help="networks to train (default: relightable if the capture has lights, else default)",
    )
    add(
        "--identities",
        nargs="+",
        default=[],
        metavar="NAME",
        help="names of the people of several captures (default: the captures' folders); needs --config paper",
    )
    add("--hand", type=Path, help="hand model of the capture (default: the built-in one it shows)")
    add_options(parser.add_mutually_exclusive_group(), TrainConfig, "steps", "minutes")
    add_options(parser, TrainConfig, "batch", "seed", "licence")
    add("--resume", action="store_true", help="continue from the checkpoint beside the output")
    add(
        "--from",
        dest="base",
        type=avatar_path,
        metavar="AVATAR",
        help="fine-tune this avatar, which must be of the same networks and, without --from-hand, of the same hand",
    )
    add(
        "--from-hand",
        type=Path,
        metavar="HAND",
        help="hand model of --from, if it is another version of the capture's: what it learnt is carried over",
    )
    add(
        "--person",
        type=avatar_path,
        metavar="AVATAR",
        help="start from the person made from this capture, in the light that it finds there; light and skin stay",
    )
    add("--half-size", action="store_true", help="train on images of half their size, as a start for --from")
    add_options(parser, TrainConfig, "ema_decay")
    add_options(parser, LossConfig, "perceptual", "perceptual_share", "perceptual_region")
    add(
        "--perceptual-weights",
        type=Path,
        metavar="FILE",
        help="VGG19 weights, .safetensors or torchvision's .pth (default: torchvision's cache, or its download)",
    )
    add(
        "--lpips-heads",
        type=Path,
        metavar="FILE",
        help="linear heads for the network in --perceptual-weights: the perceptual loss is LPIPS, as in the paper",
    )
    add(
        "--lpips-range",
        choices=("standard", "reference"),
        default="standard",
        help="input range of LPIPS: [-1, 1], or [0, 1] as the paper's authors used (default: %(default)s)",
    )
    add("--refine", action="store_true", help="correct training poses and shape; writes AVATAR.refined/")
    add("--refine-surface", action="store_true", help="--refine, and correct the surface of the hand model too")
    add("--camera-colours", action="store_true", help="train a gain and a bias per camera, for real camera rigs")
    add(
        "--output-cameras",
        dest="avatar_cameras",
        type=int,
        nargs="+",
        default=[],
        metavar="N",
        help="--camera-colours, and give the avatar the mean colours of these cameras (default: of the first camera)",
    )
    add_options(parser, ReportConfig, "preview_minutes", "tensorboard")
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help="default: %(default)s")
    add("--precision", choices=("fp32", "bf16"), default="bf16", help="default: %(default)s")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    from .processes import joined_processes, process_device

    device = process_device(args.device)
    with joined_processes(device) as processes:
        return _train(args, device, processes)


def _train(args: argparse.Namespace, device: torch.device, processes: Processes) -> dict[str, Any]:
    from .loop import train
    from .processes import ComputeSetup

    output = _checked_output(args.output)
    config = _config_of(args)
    compute = ComputeSetup(device, args.precision, processes)
    setup = _setup(args, config.loss, output, device)
    before = _held_out_db(setup, setup.base.avatar, device) if args.person and setup.base else None
    result = train(setup, config, output, compute, from_options(ReportConfig, args), args.resume)
    if processes.is_first and config.minutes is not None and result.progress.step < _FEW_STEPS:
        warn(
            f"{output}: {config.minutes:g} minutes brought only {result.progress.step} steps, below {_FEW_STEPS:,} an "
            "avatar is blurred or worse; give more --minutes, or --half-size and --from an avatar that ships"
        )
    if not processes.is_first:
        return {}
    summary = _summary(output, result)
    if before is None:
        return summary
    after = _held_out_db(setup, result.avatar, device)
    return {**summary, **_brought(f"keep {args.person}, or give more --steps", before, after)}


def _brought(remedy: str, before_db: float, after_db: float) -> dict[str, float]:
    """Say what training brought over the person's maps alone; warn if it did harm."""
    brought_db = after_db - before_db
    if brought_db < 0:
        warn(f"held-out pictures lost {-brought_db:.1f} dB by training; {remedy}")
    return {"held_out_before_db": round(before_db, 2), "brought_db": round(brought_db, 2)}


def _config_of(args: argparse.Namespace) -> TrainConfig:
    """Make the settings of the training; of the paper's, those that are given replace its own."""
    if args.config != "paper":
        return from_options(TrainConfig, args, loss=from_options(LossConfig, args))
    given = {name: value for name, value in vars(args).items() if _is_given(name, args.argv)}
    loss = {name: value for name, value in given.items() if hasattr(PAPER.loss, name)}
    own = {name: value for name, value in given.items() if hasattr(PAPER, name)}
    return replace(PAPER, **own, loss=replace(PAPER.loss, **loss))


def _is_given(name: str, argv: Sequence[str]) -> bool:
    flag = "--" + name.replace("_", "-")
    return any(word == flag or word.startswith(f"{flag}=") for word in argv)


def _setup(args: argparse.Namespace, loss: LossConfig, output: Path, device: torch.device) -> TrainingSetup:
    from ..avatars.avatar import PRESETS
    from ..hand.model_file import DEFAULT_HAND, load_hand_model
    from .setup import TrainingSetup, load_base_avatar

    hand = load_hand_model(args.hand or DEFAULT_HAND)
    if len(args.captures) > 1 or args.identities:
        _check_identities(args)
    if args.person:
        args.base, hand = _person_base(args, hand, output), load_hand_model(DEFAULT_HAND)
        args.captures = [output.with_suffix(".lit")]
    capture, names = _capture_of(args, hand)
    if args.from_hand and not args.base:
        raise LiveHandError("--from-hand is the hand of the avatar to start from; give that avatar with --from")
    from_hand = load_hand_model(args.from_hand) if args.from_hand else None
    base = load_base_avatar(args.base, from_hand) if args.base else None
    perceptual = _perceptual(args) if loss.perceptual > 0 else None
    corrections = _corrections(args, capture, hand, output, device)
    config = args.config or ("relightable" if capture.is_lit else "default")
    if config == "relightable" and (args.camera_colours or args.avatar_cameras):
        raise LiveHandError(
            "a relightable avatar's colours are its own in any light, --camera-colours would be lost; "
            "leave it out, or train with --config default"
        )
    networks = PRESETS[config]
    if names:
        networks = replace(networks, field=replace(networks.field, identities=names))
    return TrainingSetup(capture, hand, networks, perceptual, corrections, base)


def _capture_of(args: argparse.Namespace, hand: HandModel) -> tuple[Capture, tuple[str, ...]]:
    """Read and check the capture, or several as one with the names of their people."""
    from ..avatars.identities import checked_names
    from ..capture.joined import joined

    captures = [_checked_capture(folder, hand, args.half_size) for folder in args.captures]
    if len(captures) == 1:
        return captures[0], ()
    names = args.identities or [folder.resolve().name for folder in args.captures]
    return joined(captures), checked_names(tuple(names))


def _checked_capture(folder: Path, hand: HandModel, is_halved: bool) -> Capture:
    from ..capture.capture import load_capture
    from ..capture.check import check_capture
    from ..capture.half_size import half_size
    from ..motion.capture_gate import capture_doubt
    from ..surface.skin_version import is_current_skin

    capture = load_capture(folder)
    check_capture(capture, hand)
    if doubt := capture_doubt(capture, hand):
        warn(f"{folder}: check the poses: {doubt}")
    if is_current_skin(capture.provenance) is False:
        warn(f"{folder} shows the built-in skin of another version, whose detail differs; capture it anew")
    return half_size(capture) if is_halved else capture


def _check_identities(args: argparse.Namespace) -> None:
    """Refuse what people who share a network cannot have."""
    if args.config != "paper":
        raise LiveHandError(
            f"people who share a network have codes in the paper's alone, got --config {args.config or 'default'}; "
            "add --config paper, or train one avatar a person"
        )
    single = ("person", "refine", "refine_surface", "camera_colours", "output_cameras")
    if given := [name for name in single if _is_given(name, args.argv)]:
        raise LiveHandError(
            f"--{given[0].replace('_', '-')} is of one person's capture, got several; train them one by one"
        )
    if args.identities and len(args.identities) != len(args.captures):
        raise LiveHandError(
            f"--identities must name the people of {len(args.captures)} captures, got {len(args.identities)} names"
        )


def _perceptual(args: argparse.Namespace) -> PerceptualDistance:
    """Load the perceptual distance: of the paper, unless files are named, LPIPS by the VGG16 that has been fetched."""
    from ..evaluation.perceptual.fetched import fetched_lpips
    from .losses import load_perceptual_distance

    if args.config == "paper" and args.perceptual_weights is None:
        return fetched_lpips("vgg16", args.lpips_range)
    return load_perceptual_distance(args.perceptual_weights, args.lpips_heads, args.lpips_range)


def _person_base(args: argparse.Namespace, hand: HandModel, output: Path) -> Path:
    """Write the capture in its person's light beside the output; returns the avatar to start from."""
    from ..avatars.file import load_avatar
    from ..hand.model_file import load_default_hand
    from ..person.lit_capture import write_lit_capture

    if args.base or args.from_hand:
        raise LiveHandError("--person is the avatar to start from; leave out --from and --from-hand")
    model = load_default_hand()
    other = None if hand.sha256 == model.sha256 else hand
    write_lit_capture(args.captures[0], load_avatar(args.person), model, other, output.with_suffix(".lit"), warn)
    return args.person


def _held_out_db(setup: TrainingSetup, avatar: Avatar, device: torch.device) -> float:
    """Measure the PSNR on the hand in held-out views."""
    from .preview import HeldOutPreview

    shown = HeldOutPreview(setup.capture, setup.hand, device, _HELD_OUT_VIEWS).render(avatar)
    return nan if shown is None else shown.metrics["psnr_hand"]


def _corrections(
    args: argparse.Namespace, capture: Capture, hand: HandModel, output: Path, device: torch.device
) -> tuple[Correction, ...]:
    from .colour_calibration import camera_colours
    from .refined_capture import refined_poses
    from .refinement import RefinementConfig

    corrections = []
    if args.refine or args.refine_surface:
        config = RefinementConfig(surface_deviation_m=_SURFACE_DEVIATION_M if args.refine_surface else 0.0)
        corrections.append(refined_poses(capture, hand, config, output.with_suffix(".refined"), device))
    if args.config == "paper" and not capture.identities:  # a tint of all of one's cameras would be one's skin
        corrections.append(camera_colours(capture, args.avatar_cameras, PAPER_CAMERA_RATE))
    elif args.camera_colours or args.avatar_cameras:
        corrections.append(camera_colours(capture, args.avatar_cameras))
    return tuple(corrections)


def _summary(output: Path, result: TrainingResult) -> dict[str, Any]:
    return {
        "avatar": str(output),
        "steps": result.progress.step,
        "skipped_steps": result.progress.skipped,
        "minutes": round(result.progress.seconds / 60, 2),
        "megabytes": round(output.stat().st_size / 1e6, 2),
        "data_wait_share": round(result.data_wait_share, 4),
        "held_out": {name: round(value, 3) for name, value in result.held_out.items()},
    }


def _checked_output(path: Path) -> Path:
    if path.suffix != ".safetensors":
        raise LiveHandError(f"an avatar's file must end in .safetensors, got {path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise LiveHandError(f"the avatar's folder {path.parent} must be writable, got {error}") from error
    return path


COMMAND = Command("train", "train an avatar on a capture", _add_arguments, _run)
