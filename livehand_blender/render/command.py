"""`livehand render`: arguments, and the call."""

from __future__ import annotations

import argparse
import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...backend.avatars import SKINS, avatar_path
from ...backend.command import parse_size_px, say

if TYPE_CHECKING:
    from .sequence import FrameProgress

FORMATS = ("exr", "png")
_FRAME_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+))?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("shot", type=Path, metavar="SHOT.blend", help="the scene, with a LiveHand hand and a camera")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the frames")
    parser.add_argument("--frames", type=parse_frames, metavar="1-24,30", help="default: the scene's range")
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


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Render the sequence; returns what was done."""
    from .plan import SequencePlan
    from .sequence import write_sequence

    plan = SequencePlan(
        shot=args.shot,
        folder=args.output,
        frames=args.frames,
        formats=args.format,
        overwrite=args.overwrite,
        avatar=args.avatar,
        size_px=args.size,
        device=args.device,
        precision=args.precision,
    )
    with _registered():
        report = write_sequence(plan, _say_progress)
    return {
        "folder": str(report.folder),
        "frames": report.written + report.skipped,
        "written": report.written,
        "skipped": report.skipped,
        "seconds_per_frame": round(report.seconds_per_frame, 3),
        "summary": (
            f"{report.folder}: {report.written + report.skipped} frames ({report.written} written, "
            f"{report.skipped} already there), {report.seconds_per_frame:.2f} s/frame"
        ),
    }


@contextlib.contextmanager
def _registered() -> Iterator[None]:
    """LiveHand's classes, unless a caller has them registered already."""
    import bpy

    from ... import register, unregister

    if hasattr(bpy.types.Scene, "livehand"):
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()  # a render engine that is still registered at exit hangs Blender 4.5


def _say_progress(progress: FrameProgress) -> None:
    done = f"frame {progress.frame} ({progress.number}/{progress.count})"
    say(f"{done}: already there" if progress.seconds is None else f"{done}: {progress.seconds:.2f} s")


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


def parse_formats(text: str) -> tuple[str, ...]:
    """`exr`, `png` or both -> each once, in the order given."""
    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    if not set(formats) <= set(FORMATS):
        raise argparse.ArgumentTypeError(f"must be exr, png or exr,png, got {text!r}")
    return formats
