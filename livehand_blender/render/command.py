"""The command `livehand render`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from ...backend.avatars.library import SHIPPED, avatar_path, check_avatar_path
from ...backend.batch.content_credentials import add_signing_arguments, signing_key
from ...backend.batch.folders import folders_of, writable_folder
from ...backend.batch.frame_paths import FORMATS
from ...backend.batch.frame_selection import ALL, parse_chunk, parse_frames
from ...backend.batch.report import RunReport
from ...backend.batch.workers import run_workers, stop_with_parent
from ...backend.records.errors import LiveHandError
from ...backend.system.command import INTERRUPTED, OTHER_VERSION, FailedInPart, parse_count, parse_size_px


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
        help="folder of the frames; with several shots, each has its own folder in it",
    )
    parser.add_argument("--frames", type=parse_frames, metavar="1-24,30", help="default: the scene's range")
    parser.add_argument(
        "--chunk", type=parse_chunk, default=ALL, metavar="I/N", help="render the I-th of N parts of the frames"
    )
    parser.add_argument(
        "--avatar",
        type=avatar_path,
        metavar="NAME|FILE",
        help=f"{', '.join(SHIPPED)} or a file (default: the hand's own)",
    )
    parser.add_argument("--size", type=parse_size_px, metavar="WxH", help="image size, px; default: the scene's")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda", "mps"), help="default: the scene's")
    parser.add_argument("--precision", choices=("fp32", "bf16"), help="default: the scene's")
    parser.add_argument("--format", type=parse_formats, metavar="exr|png|exr,png", help="default: exr; pose files: png")
    parser.add_argument("--overwrite", action="store_true", help="also render frames that already exist")
    parser.add_argument(
        "--strict",
        action="store_true",
        help=f"render nothing beside frames of another version (avatar, .blend, ...); exit code {OTHER_VERSION}",
    )
    parser.add_argument(
        "--file-outputs",
        choices=("keep", "mute", "move"),
        default="keep",
        help="File Output nodes that write outside DIR: keep them (with a warning), mute them, or move them into DIR",
    )
    parser.add_argument(
        "--watermark", action="store_true", help="write an invisible watermark of the avatar into the hands"
    )
    add_signing_arguments(parser, is_required=False)
    parser.add_argument(
        "--jobs", type=parse_count, default=1, metavar="N", help="worker processes that share the frames"
    )
    # Passed to worker processes: when the run began, see SequencePlan.
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)


def run(args: argparse.Namespace, in_blender: Callable[[], AbstractContextManager[None]]) -> dict[str, Any]:
    """Render the shots; returns the result.

    Args:
        args: the command's arguments.
        in_blender: a context in which LiveHand's classes are registered with Blender.

    Raises:
        FailedInPart: a shot failed, or with `--strict` frames that stay are of another version.
    """
    folders = folders_of(args.shots, args.output)
    report = RunReport(folders, args.output, args.json, is_quiet=args.worker is not None)
    if args.worker is not None:
        _work(args, folders, report, in_blender)
    elif args.jobs > 1:
        with writable_folder(args.output) as began_ns:
            run_workers(args.argv, args.jobs, began_ns, report, may_refuse=args.strict)
    else:
        _render(args, folders, report, in_blender)
    differs = args.worker is None and report.compare_versions()
    if report.has_failed:
        raise FailedInPart(report.result())
    if differs and args.strict:
        raise FailedInPart(report.result(), OTHER_VERSION)
    return report.result()


def _work(args: argparse.Namespace, folders: Mapping[Path, Path], report: RunReport, in_blender: Callable) -> None:
    """Render as a worker process; the parent process reports how it ends."""
    try:
        stop_with_parent()  # inside: a parent that has already ended interrupts this process at once
        _render(args, folders, report, in_blender)
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(INTERRUPTED)


def _render(args: argparse.Namespace, folders: Mapping[Path, Path], report: RunReport, in_blender: Callable) -> None:
    from .plan import SequencePlan
    from .sequence import write_sequences

    signing, formats = signing_key(args), args.format or ("exr",)
    if signing is not None and "png" not in formats:
        raise LiveHandError("signed frames must be PNGs, C2PA has no place in OpenEXR; add --format exr,png")
    if args.avatar is not None:
        check_avatar_path(args.avatar)
    with in_blender():
        plans = [
            SequencePlan(
                shot=shot,
                folder=folder,
                frames=args.frames,
                chunk=args.chunk,
                formats=formats,
                overwrite=args.overwrite,
                is_strict=args.strict,
                file_outputs=args.file_outputs,
                began_ns=args.worker,
                avatar=args.avatar,
                size_px=args.size,
                device=args.device,
                precision=args.precision,
                has_watermark=args.watermark,
                signing=signing,
            )
            for shot, folder in folders.items()
        ]
        write_sequences(plans, report)


def parse_formats(text: str) -> tuple[str, ...]:
    """Parse `exr`, `png` or both, each once, in the given order.

    Raises:
        argparse.ArgumentTypeError: the text has another format.
    """
    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    if not set(formats) <= set(FORMATS):
        raise argparse.ArgumentTypeError(f"must be exr, png or exr,png, got {text!r}")
    return formats
