"""`livehand adjust-person`: the same person with another tone, age or hair; also as a job."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...avatars.library import avatar_path
from ...records.errors import LiveHandError
from ...surface.people.look import ADJUSTABLE, NUMBERS
from ...system.child_job import ChildJob, JobProgress, run_job
from ...system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("avatar", type=avatar_path, help="a file, or the name of one that ships")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the avatar to write (.safetensors)"
    )
    for name in ADJUSTABLE:
        spec = NUMBERS[name]
        limits = f"{spec.low:g} to {spec.high:g}"
        parser.add_argument(f"--{name}", type=float, metavar="X", help=f"{spec.meaning}; {limits} (default: as it is)")
    parser.add_argument("--name", help="for display (default: the file's name)")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    return adjusting(args, lambda line: None)


def adjusting(args: argparse.Namespace, log: Callable[[str], None]) -> dict[str, Any]:
    """Make the avatar of the command's arguments; returns what the command reports.

    Raises:
        LiveHandError: a number is beyond its limits, or a file cannot be read or written.
    """
    if args.output.suffix.lower() != ".safetensors":
        raise LiveHandError(f"an avatar must be written to a .safetensors file, got {args.output.name}")

    from ...avatars.file import load_avatar, save_avatar
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from .adjusting import adjusted_person, current_numbers

    avatar = load_avatar(args.avatar)
    given = {name: getattr(args, name) for name in ADJUSTABLE}
    adjusted = adjusted_person(avatar, load_hand_model(DEFAULT_HAND), given, args.name or args.output.stem, log)
    save_avatar(adjusted, args.output)
    assert adjusted.surface is not None
    numbers = current_numbers(adjusted.surface)
    summary = ", ".join(f"{name} {value:g}" for name, value in numbers.items())
    return {"avatar": str(args.output), **numbers, "summary": f"{args.output}: {summary}"}


COMMAND = Command("adjust-person", "give an avatar's person another tone, age or hair", _add_arguments, _run)


def start_adjusting(arguments: list[str]) -> ChildJob:
    """Start the command in a process of its own; its result is what the command reports."""
    return ChildJob.start("adjusting the avatar", "person.invented.adjust_command", arguments)


def run() -> None:
    """Adjust the person in the process of a job, whose request are the command's arguments."""
    parser = argparse.ArgumentParser(COMMAND.name)
    _add_arguments(parser)
    run_job(
        lambda request, report: adjusting(parser.parse_args(request), lambda line: report(JobProgress(line))),
        "the avatar needs more memory than is free; close other programs",
    )
