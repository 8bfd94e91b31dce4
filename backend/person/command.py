"""`livehand person`: from a film, photographs or a capture of somebody's hand to an avatar of theirs; also as a job."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..hand.model_file import DEFAULT_HAND, load_hand_model
from ..records.errors import LiveHandError
from ..records.side import SIDES
from ..system.child_job import ChildJob, JobProgress, Report, run_job
from ..system.command import Command, parse_fov

if TYPE_CHECKING:
    from ..hand.model import HandModel
    from ..records.hand_picture import PicturedHand
    from .kept_steps import KeptSteps
    from .making import MadePerson
    from .review import PersonFigures


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "pictures", type=Path, help="a film, a folder of photographs, or a capture, of one hand from several sides"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the avatar to write (.safetensors)"
    )
    parser.add_argument("--name", help="of the person, for display (default: the file's name)")
    parser.add_argument(
        "--hand", type=Path, metavar="FILE", help="hand model of a capture's poses, if it is not the built-in one"
    )
    parser.add_argument("--side", choices=SIDES, help="the hand to take (default: the one seen longer)")
    parser.add_argument(
        "--length-mm",
        type=float,
        metavar="MM",
        help="of the hand, from the wrist's crease to the tip of the straight middle finger: one camera cannot see it",
    )
    parser.add_argument(
        "--fov",
        type=parse_fov,
        metavar="DEG",
        help="the camera's angle of view, horizontal of a film, along the longer side of photographs that do not tell "
        "it (default: a phone's, 65 along the longer side)",
    )
    parser.add_argument("--consent", default="", metavar="TEXT", help="what the person agreed to; kept in the avatar")
    parser.add_argument("--licence", default="not stated", metavar="TEXT", help="of the avatar; kept in it")
    parser.add_argument("--sheet", type=Path, metavar="FILE.png", help="pictures beside the avatar, and what was seen")
    parser.add_argument("--weights", type=Path, metavar="DIR", help="the tracker's folder, if it is not the user's own")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    return making(args, _say)


def making(args: argparse.Namespace, report: Report) -> dict[str, Any]:
    """Make the avatar of the command's arguments; returns what the command reports.

    Raises:
        LiveHandError: the pictures, or the output, cannot be used.
    """
    from ..avatars.file import save_avatar
    from .kept_steps import KeptSteps
    from .person_avatar import person_avatar
    from .review import held_out_figures, write_sheet

    if args.output.suffix.lower() != ".safetensors":
        raise LiveHandError(f"an avatar must be written to a .safetensors file, got {args.output.name}")
    if args.sheet is not None and args.sheet.suffix.lower() != ".png":
        raise LiveHandError(f"--sheet must name a .png file, got {args.sheet.name}")
    model = load_hand_model(DEFAULT_HAND)
    steps = KeptSteps.beside(args.output, _inputs(args))
    try:
        made, hand = _made(args, model, steps, report)
    except LiveHandError:
        steps.remove()  # the same pictures would fail again
        raise
    beta = hand.pictures[0].pose.beta
    figures = held_out_figures(made.model, hand.pictures, made.lights)
    measured = {} if figures is None else {key: round(value, 3) for key, value in figures._asdict().items()}
    provenance = {
        "source": hand.source,
        "pictures": len(hand.pictures),
        "consent": args.consent,
        "licence": args.licence,
    }
    avatar = person_avatar(made, model, beta, args.name or args.output.stem, hand.side, provenance)
    save_avatar(avatar, args.output)
    numbers, seen = made.completed.numbers, float((made.completed.confidence > 0.5).mean())
    if args.sheet:
        write_sheet(args.sheet, made, hand.pictures, f"{args.output.stem}: {seen:.0%} of the skin was seen")
    steps.remove()
    return {
        "avatar": str(args.output),
        "pictures": len(hand.pictures),
        "seen": round(seen, 3),
        "melanin": round(numbers.melanin, 3),
        "blood": round(numbers.blood, 3),
        "held_out": measured,
        "notes": list(hand.notes),
        "summary": "\n".join(
            [
                f"{args.output}: of {len(hand.pictures)} pictures, {seen:.0%} of the skin seen; "
                f"melanin {numbers.melanin:.2f}, blood {numbers.blood:.2f}",
                *([] if figures is None else [_figures_line(figures)]),
                *(f"  {note}" for note in hand.notes),
            ]
        ),
    }


def _made(
    args: argparse.Namespace, model: HandModel, steps: KeptSteps, report: Report
) -> tuple[MadePerson, PicturedHand]:
    from .fit.hand_size import check_length, sized
    from .making import MakingOptions, lines_of_making, person_of_pictures
    from .person_avatar import shipped_bases
    from .sources import PictureSource, pictured_hand

    other = load_hand_model(args.hand) if args.hand else None
    source = PictureSource(args.pictures, args.side, args.weights, other, args.fov)
    length_m = None if args.length_mm is None else args.length_mm / 1000
    if length_m is not None:
        check_length(length_m)
    hand = pictured_hand(source, model, lambda line: report(JobProgress(line)), steps)
    hand = hand if length_m is None else sized(hand, model, length_m)
    options = MakingOptions(length_m=length_m)
    countdown = Countdown(report, lines_of_making(hand, options))
    return person_of_pictures(shipped_bases(model), hand, options, countdown, steps)


class Countdown:
    """Reports lines of a work that tells so many, with the share that is done and about how long the rest takes.

    Args:
        report: is told each line.
        lines: of the whole work.
    """

    def __init__(self, report: Report, lines: int):
        self._report, self._lines, self._count = report, lines, 0
        self._began_s = time.monotonic()

    def __call__(self, line: str) -> None:
        """Report the next line."""
        self._count += 1
        share = min(self._count / self._lines, 1.0)
        left_s = (time.monotonic() - self._began_s) * (1 - share) / share
        left = f", about {left_s / 60:.0f} min left" if left_s >= _A_MINUTE_S else ""
        self._report(JobProgress(f"{line} ({share:.0%}{left})", share))


_A_MINUTE_S = 45.0  # from which it is one


def _inputs(args: argparse.Namespace) -> dict[str, object]:
    """Return what decides the steps' results; a path without a file fails later, in words of its own."""
    from .kept_steps import digest_of

    files = [path and path.exists() and digest_of(path) for path in (args.pictures, args.hand)]
    return {"files": files, "name": args.pictures.name, "side": args.side, "length_mm": args.length_mm, "fov": args.fov}


def _figures_line(figures: PersonFigures) -> str:
    return (
        f"  {figures.pictures} pictures that were held out: {figures.psnr_db:.1f} dB on the hand, "
        f"{figures.aligned_psnr_db:.1f} dB aligned, outlines overlap by {figures.overlap:.3f}"
    )


def _say(progress: JobProgress) -> None:
    import sys

    print(progress.text, file=sys.stderr, flush=True)  # noqa: T201


COMMAND = Command("person", "make an avatar of somebody's hand from pictures", _add_arguments, _run)


def start_person(arguments: list[str]) -> ChildJob:
    """Start the command in a process of its own; its result is what the command reports."""
    return ChildJob.start("making the avatar", "person.command", arguments)


def run() -> None:
    """Make the person in the process of a job, whose request are the command's arguments."""
    parser = argparse.ArgumentParser(COMMAND.name)
    _add_arguments(parser)
    run_job(
        lambda request, report: making(parser.parse_args(request), report),
        "the avatar needs more memory than is free; close other programs, or give fewer pictures",
    )
