"""`livehand render`: arguments, and the call."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from ...backend.avatars.library import SKINS, avatar_path
from ...backend.batch.chunk import ALL, Chunk
from ...backend.batch.folders import folders_of, writable_folder
from ...backend.batch.report import RunReport
from ...backend.batch.workers import run_workers, stop_with_parent
from ...backend.runtime.command import INTERRUPTED, FailedInPart, parse_count, parse_size_px

FORMATS = ("exr", "png")
_FRAME_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+))?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "shots",
        type=Path,
        nargs="+",
        metavar="SHOT.blend",
        help="scenes, each with a LiveHand hand and a camera; or one pose file",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of the frames; of a folder per shot if there are several",
    )
    parser.add_argument("--frames", type=parse_frames, metavar="1-24,30", help="default: the scene's range")
    parser.add_argument(
        "--chunk", type=parse_chunk, default=ALL, metavar="I/N", help="the I-th of N parts of the frames"
    )
    parser.add_argument(
        "--avatar",
        type=avatar_path,
        metavar="NAME|FILE",
        help=f"{', '.join(SKINS)} or a file (default: the hand's own)",
    )
    parser.add_argument("--size", type=parse_size_px, metavar="WxH", help="image size, px; default: the scene's")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), help="default: the scene's")
    parser.add_argument("--precision", choices=("fp32", "bf16"), help="default: the scene's")
    parser.add_argument("--format", type=parse_formats, default=("exr",), metavar="exr|png|exr,png")
    parser.add_argument("--overwrite", action="store_true", help="render frames that are already there as well")
    parser.add_argument(
        "--jobs", type=parse_count, default=1, metavar="N", help="worker processes that share the frames"
    )
    # Of such a worker: when the run began, see SequencePlan.
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)


def run(args: argparse.Namespace, in_blender: Callable[[], AbstractContextManager[None]]) -> dict[str, Any]:
    """Render the shots; returns what was done.

    Args:
        args: the command's.
        in_blender: within, Blender knows LiveHand's classes.

    Raises:
        FailedInPart: a shot failed.
    """
    folders = folders_of(args.shots, args.output)
    report = RunReport(folders, args.output, args.json, is_quiet=args.worker is not None)
    if args.worker is not None:
        _work(args, folders, report, in_blender)
    elif args.jobs > 1:
        with writable_folder(args.output) as began_ns:
            run_workers(args.argv, args.jobs, began_ns, report)
    else:
        _render(args, folders, report, in_blender)
    if report.has_failed:
        raise FailedInPart(report.result())
    return report.result()


def _work(args: argparse.Namespace, folders: Mapping[Path, Path], report: RunReport, in_blender: Callable) -> None:
    """As a worker: whoever started it tells people of its end."""
    stop_with_parent()
    try:
        _render(args, folders, report, in_blender)
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(INTERRUPTED)


def _render(args: argparse.Namespace, folders: Mapping[Path, Path], report: RunReport, in_blender: Callable) -> None:
    from .batch import write_batch
    from .plan import SequencePlan

    with in_blender():
        plans = [
            SequencePlan(
                shot=shot,
                folder=folder,
                frames=args.frames,
                chunk=args.chunk,
                formats=args.format,
                overwrite=args.overwrite,
                began_ns=args.worker,
                avatar=args.avatar,
                size_px=args.size,
                device=args.device,
                precision=args.precision,
            )
            for shot, folder in folders.items()
        ]
        write_batch(plans, report)


def parse_frames(text: str) -> tuple[int, ...]:
    """`1-24,30` -> frame numbers in that order, each once.

    Raises:
        argparse.ArgumentTypeError: malformed, or no frame in it.
    """
    frames: dict[int, None] = {}
    for part in text.split(","):
        match = _FRAME_RANGE.fullmatch(part.strip())
        if not match:
            raise argparse.ArgumentTypeError(f"must be frames and ranges such as 1-24,30, got {text!r}")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise argparse.ArgumentTypeError(f"a range must run forwards and hold a frame, got {part.strip()!r}")
        frames.update(dict.fromkeys(range(first, last + 1)))
    return tuple(frames)


def parse_chunk(text: str) -> Chunk:
    """`2/8` -> the second of eight.

    Raises:
        argparse.ArgumentTypeError: malformed, or no such part.
    """
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"must be I/N with I from 1 to N, such as 2/8, got {text!r}")
    return Chunk(int(number), int(count))


def parse_formats(text: str) -> tuple[str, ...]:
    """`exr`, `png` or both -> each once, in the order given."""
    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    if not set(formats) <= set(FORMATS):
        raise argparse.ArgumentTypeError(f"must be exr, png or exr,png, got {text!r}")
    return formats
