"""`livehand export --format splats`: a take, or a scene's hands, as Gaussian splats that are fitted to our frames."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..records.errors import LiveHandError
from ..system.command import parse_count
from .export_options import RIG, SPLATS, check_options

if TYPE_CHECKING:
    from ..motion.writers.take import Take, TakenHand
    from ..records.shot import Shot
    from ..render.splats.lit_hand import LitHand
    from ..system.child_job import JobProgress

FORMAT = SPLATS

Frames = Mapping[int, "Sequence[LitHand]"]
"""The hands of frames, by number."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of splats."""
    for option, metavar, words in (
        ("--splats", "N", "about how many a hand (default: 50000)"),
        ("--views", "N", "views they are fitted to (default: 48)"),
        ("--view-size", "PX", "of such a view (default: 512)"),
    ):
        parser.add_argument(option, type=parse_count, metavar=metavar, help=f"splats: {words}")


def is_wanted(args: argparse.Namespace) -> bool:
    """Tell whether the output is splats: by the format, or by a suffix that only they have."""
    return args.format == FORMAT or (args.format is None and args.output.suffix.lower() == ".ply")


def run(args: argparse.Namespace, frames: Callable[[argparse.Namespace], Frames]) -> dict[str, Any]:
    """Fit splats to a source's frames, and write them to the output.

    Args:
        args: of the command.
        frames: reads the source.

    Raises:
        LiveHandError: the source cannot be read, an option is out of its range, or an avatar is not relightable.
    """
    from ..render.splats.lit_hand import SplatOptions
    from ..render.splats.sequence import write_sequence
    from ..render.splats.splat_files import file_axes

    if args.rig:
        raise LiveHandError(f"{RIG} is of motion, got --format splats; leave it out")
    check_options(args, FORMAT)
    file_axes(args.output)
    chosen = {"count": args.splats, "views": args.views, "size_px": args.view_size}
    options = SplatOptions(**{name: value for name, value in chosen.items() if value is not None})
    written = write_sequence(frames(args), args.output, options, _show_progress)
    return {
        "output": [str(file) for file in written.files],
        "format": FORMAT,
        "frames": len(written.files),
        "splats": written.size,
        "held_out_db": [round(float(value), 2) for value in written.held_out_db],
        "least_db": round(written.least_db, 2),
        "summary": written.summary,
    }


def frames_of_take(args: argparse.Namespace, take: Take) -> Frames:
    """Light a take's hands as `livehand render` does those of files, about each wrist, in the skin of an avatar.

    Raises:
        LiveHandError: the avatar cannot be read, or is of another hand model.
    """
    from ..avatars.file import load_avatar
    from ..avatars.library import shipped_avatar_path
    from ..avatars.origin import read_origin
    from ..image.grade import Grade
    from ..render.renderer import Renderer
    from ..render.splats.lit_hand import LitHand

    path = args.avatar or shipped_avatar_path()
    avatar, origin = load_avatar(path), read_origin(path)
    renderers = {hand.side: Renderer(avatar, hand.model) for hand in take.hands}
    held = [hand.held(take.count) for hand in take.hands]
    return {
        index + 1: [
            LitHand(renderers[hand.side], _studio_shot(hand, index), origin, Grade(), hand.side) for hand in held
        ]
        for index in range(take.count)
    }


def _studio_shot(hand: TakenHand, index: int) -> Shot:
    from ..geometry.framing import fitting_camera
    from ..hand.lbs import posed_vertices
    from ..motion.spaces import rest_wrists
    from ..records.shot import Shot
    from ..render.studio_light import studio_light

    model, pose = hand.own_model, hand.motion.pose(index)
    wrist = rest_wrists(model, pose.beta) + pose.transl
    vertices = wrist + hand.scale * (posed_vertices(model, pose) - wrist)
    light = studio_light()
    lamps = tuple(replace(lamp, position=lamp.position + wrist) for lamp in light.lamps)
    camera = fitting_camera(vertices, (0.0, -1.0, 0.0), (64, 64), 0.9)
    return Shot(pose, vertices, camera, replace(light, lamps=lamps))


def _show_progress(progress: JobProgress) -> None:
    if sys.stderr.isatty():
        share = progress.share or 0
        sys.stderr.write(f"\r{progress.text:<40}{100 * share:3.0f} %" + ("\n" if share >= 1 else ""))
        sys.stderr.flush()
