"""`livehand new-person`: an avatar of an invented person, from numbers and a seed; also as a job."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...records.errors import LiveHandError
from ...surface.people.look import MOST_SEED, NUMBERS, PersonLook

if TYPE_CHECKING:
    from ...avatars.avatar import Avatar
from ...system.child_job import ChildJob, JobProgress, run_job
from ...system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the avatar to write (.safetensors)"
    )
    parser.add_argument(
        "--seed", type=int, metavar="N", help=f"of lines, cells, spots and shape, 0 to {MOST_SEED} (default: a new one)"
    )
    for name, spec in NUMBERS.items():
        limits = f"{spec.low:g} to {spec.high:g}"
        parser.add_argument(
            f"--{name}", type=float, metavar="X", help=f"{spec.meaning}; {limits} (default: drawn from the seed)"
        )
    parser.add_argument("--name", help="of the person, for display (default: the file's name)")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    return making(args, lambda line: None)


def making(args: argparse.Namespace, log: Callable[[str], None]) -> dict[str, Any]:
    """Make the avatar of the command's arguments; returns what the command reports.

    Raises:
        LiveHandError: a number is beyond its limits, or the output cannot be written.
    """
    if args.output.suffix.lower() != ".safetensors":
        raise LiveHandError(f"an avatar must be written to a .safetensors file, got {args.output.name}")
    given = {name: getattr(args, name) for name in NUMBERS}
    seed = _free_seed() if args.seed is None else args.seed
    look = PersonLook.of(seed, given)

    from ...avatars.file import save_avatar

    save_avatar(new_person(look, args.name or args.output.stem, log), args.output)
    numbers = look.facts()
    summary = ", ".join(f"{name} {numbers[name]:g}" for name in ("seed", *NUMBERS))
    return {"avatar": str(args.output), **numbers, "summary": f"{args.output}: {summary}"}


def new_person(look: PersonLook, name: str, log: Callable[[str], None]) -> Avatar:
    """Make the avatar of a person, relightable and without training, with its thumbnail; `log` is told what begins."""
    from ...avatars.drawn_people import drawn_avatar, nearest_base
    from ...avatars.file import load_avatar
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from ...render.thumbnail import with_thumbnail

    hand = load_hand_model(DEFAULT_HAND)
    log("choosing the nearest base")
    base = nearest_base(look.tone, load_avatar)
    log("drawing the skin")
    avatar = drawn_avatar(hand, look, name, base)
    log("rendering the thumbnail")
    return with_thumbnail(avatar, hand, "cpu")


def _free_seed() -> int:
    """Draw a seed for a person whom nobody has made yet."""
    import secrets

    return secrets.randbelow(MOST_SEED + 1)


COMMAND = Command("new-person", "make an avatar of an invented person from numbers", _add_arguments, _run)


def start_new_person(arguments: list[str]) -> ChildJob:
    """Start the command in a process of its own; its result is what the command reports."""
    return ChildJob.start("making the avatar", "person.invented.command", arguments)


def run() -> None:
    """Make the person in the process of a job, whose request are the command's arguments."""
    parser = argparse.ArgumentParser(COMMAND.name)
    _add_arguments(parser)
    run_job(
        lambda request, report: making(parser.parse_args(request), lambda line: report(JobProgress(line))),
        "the avatar needs more memory than is free; close other programs",
    )
