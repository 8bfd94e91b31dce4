"""`livehand train`: arguments, and the call. What needs torch is imported when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..command import Command
from ..errors import LiveHandError
from .config import TrainConfig

_CONFIGS = ("default", "paper")  # the names of `avatar.PRESETS`, which needs torch


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    config = TrainConfig()
    parser.add_argument("capture", type=Path, help="the capture's folder")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="AVATAR", help=".safetensors to write")
    parser.add_argument("--config", choices=_CONFIGS, default="default", help="which networks")
    parser.add_argument("--hand", type=Path, help="the capture's hand model (default: the built-in hand)")
    parser.add_argument("--steps", type=_positive, default=config.steps, help="one image each (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=config.seed)
    parser.add_argument("--licence", default=config.licence, help="of the avatar, kept in its header")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint beside the output")
    parser.add_argument(
        "--perceptual", type=float, default=config.loss.perceptual, help="weight of the perceptual loss; 0: without it"
    )
    parser.add_argument(
        "--perceptual-weights",
        type=Path,
        metavar="FILE",
        help="VGG19's weights, .safetensors or torchvision's .pth (default: torchvision's cache, then its download)",
    )
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--precision", choices=("fp32", "bf16"), default="bf16")


def _run(args: argparse.Namespace) -> dict:
    from ..avatar import PRESETS
    from ..capture import load_capture
    from ..device import torch_device
    from ..hand.model import load_default_hand, load_hand_model
    from .loop import train
    from .perceptual import load_perceptual_loss

    config = TrainConfig(steps=args.steps, seed=args.seed, licence=args.licence)
    config = replace(config, loss=replace(config.loss, perceptual=args.perceptual))
    output = _checked_output(args.output)
    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    capture = load_capture(args.capture)
    perceptual = load_perceptual_loss(args.perceptual_weights) if args.perceptual > 0 else None
    device = torch_device(args.device)
    train(capture, hand, output, config, PRESETS[args.config], perceptual, device, args.precision, args.resume)
    return {"avatar": str(output), "steps": config.steps, "megabytes": round(output.stat().st_size / 1e6, 2)}


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text!r}")
    return int(text)


def _checked_output(path: Path) -> Path:
    if path.suffix != ".safetensors":
        raise LiveHandError(f"an avatar's file must end in .safetensors, got {path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_suffix(".partial")
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise LiveHandError(f"the avatar's folder {path.parent} must be writable ({error})") from error
    return path


COMMAND = Command("train", "fit an avatar to a capture", _add_arguments, _run)
