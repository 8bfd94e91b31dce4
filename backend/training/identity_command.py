"""`livehand identity`: one person of an avatar of several as one of its own, or one more person by a code alone."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..records.errors import LiveHandError
from ..system.command import Command, parse_count
from .config import LossConfig, ReportConfig, TrainConfig

if TYPE_CHECKING:
    from ..avatars.avatar import Avatar

_CODE_RATE = 2e-2  # learning rate of a code, ten times the networks'


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("avatar", type=Path, help="an avatar of several people")
    add("--name", required=True, help="of the person, or `mean` of all; with --fit, of the new one")
    add("--fit", type=Path, metavar="CAPTURE", help="add this capture's person: the networks stay, only a code learns")
    add("-o", "--output", type=Path, required=True, metavar="AVATAR", help=".safetensors file to write")
    add("--steps", type=parse_count, default=400, help="of --fit (default: %(default)s)")
    add("--seed", type=int, default=0, help="of the order of the images, with --fit (default: %(default)s)")
    add("--hand", type=Path, help="hand model of the capture (default: the built-in one it shows)")
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help="default: %(default)s")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    from ..avatars.file import load_avatar, save_avatar
    from ..avatars.identities import identity_names, of_identity

    if args.output.suffix != ".safetensors":
        raise LiveHandError(f"an avatar's file must end in .safetensors, got {args.output.name}")
    avatar = load_avatar(args.avatar)
    if args.fit is not None:
        fitted = _fitted(args, avatar)
        return {"avatar": str(args.output), "identities": list(identity_names(fitted))}
    save_avatar(of_identity(avatar, args.name), args.output)
    return {"avatar": str(args.output), "identity": args.name}


def _fitted(args: argparse.Namespace, avatar: Avatar) -> Avatar:
    """Add the capture's person by a code that alone is trained, and save the avatar."""
    from dataclasses import replace

    from ..avatars.identities import identity_names, with_identity
    from ..capture.capture import load_capture
    from ..capture.check import check_capture
    from ..hand.model_file import DEFAULT_HAND, load_hand_model
    from .loop import train
    from .processes import ComputeSetup, process_device
    from .setup import BaseAvatar, TrainingSetup

    grown = with_identity(avatar, args.name)
    hand, capture = load_hand_model(args.hand or DEFAULT_HAND), load_capture(args.fit)
    check_capture(capture, hand)
    person = len(identity_names(grown)) - 1
    capture = replace(capture, surface=None, identities=(person,) * len(capture.poses))
    base = BaseAvatar(grown, hashlib.sha256(args.avatar.read_bytes()).hexdigest())
    setup = TrainingSetup(capture, hand, grown.config, base=base, is_code_alone=True)
    config = TrainConfig(
        steps=args.steps, seed=args.seed, learning_rate=_CODE_RATE, warmup_steps=10, loss=LossConfig(perceptual=0.0)
    )
    compute = ComputeSetup(process_device(args.device), "fp32")
    return train(setup, config, args.output, compute, ReportConfig(preview_minutes=0.0)).avatar


COMMAND = Command(
    "identity", "write one person of an avatar of several, or add one by a code alone", _add_arguments, _run
)
