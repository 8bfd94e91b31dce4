"""`livehand export`: the motion of a file as a file of another program; other sources and formats are handed in."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..avatars.library import SHIPPED, avatar_path
from ..batch.frame_selection import parse_frames
from ..records.errors import LiveHandError
from ..records.side import SIDES, Side
from ..system.command import Command, parse_count, warn
from . import export_splats
from .export_options import check_options

if TYPE_CHECKING:
    from ..hand.model import HandModel
    from ..motion.files.open_files import MotionFile
    from ..motion.writers.take import Take, TakenHand
    from ..motion.writers.writer import Writer

FORMATS = ("livehand", "mano", "smplx", "openxr", "mediapipe", "csv", "bvh", "fbx", "gltf", "usd", export_splats.FORMAT)
BLENDER_SUFFIXES = (".fbx", ".glb", ".usd", ".usda", ".usdc")
"""Of files that Blender's exporters write."""

_MOST_TEXTURE_PX = 8192

ReadTake = Callable[[argparse.Namespace], "Take"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("source", type=Path, help="a pose or landmark file, a take, an animated rig, or a .blend")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="to be written; its suffix tells the format: .npz, .json, .csv, .bvh, .fbx, .glb, .usd, .ply",
    )
    parser.add_argument("--format", choices=FORMATS, help="where a suffix has several formats (default: the first)")
    parser.add_argument("--side", choices=SIDES, help="write this hand only (default: all)")
    parser.add_argument("--hand", type=Path, metavar="FILE", help="files: the hand model (default: built-in)")
    parser.add_argument("--mano", type=Path, metavar="FILE", help="MANO's file, where poses count from its mean")
    parser.add_argument("--from-mean", action="store_true", help="mano: write angles that count from MANO's mean")
    parser.add_argument("--fps", type=float, metavar="RATE", help="files: frames per second, if the file does not say")
    parser.add_argument("--frames", type=parse_frames, metavar="1-24", help=".blend: default: the scene's range")
    parser.add_argument(
        "--avatar",
        type=avatar_path,
        metavar="NAME|FILE",
        help=f"fbx, gltf, usd: whose skin the mesh wears: {', '.join(SHIPPED)} or a file (default: a plain mesh); "
        "splats of a file of poses: of whom",
    )
    parser.add_argument("--texture-size", type=parse_count, metavar="PX", help="of the skin's textures (default: 2048)")
    export_splats.add_arguments(parser)
    parser.add_argument(
        "--rig",
        metavar="CHARACTER.blend[:ARMATURE]",
        help="key this character's own bones instead; the output is a .blend",
    )
    parser.add_argument("--bones", type=Path, metavar="JSON", help="--rig: which bone is which joint (default: guess)")
    parser.add_argument("--arm", choices=("FK", "IK"), help="--rig: the controls that move the wrist (default: FK)")


def run(
    args: argparse.Namespace, read: ReadTake | None = None, writers: Sequence[Writer] | None = None
) -> dict[str, Any]:
    """Write the source's motion to the output.

    Args:
        args: of the command.
        read: reads the take; None: from a file of poses or landmarks.
        writers: the formats; None: those that need no Blender.

    Raises:
        LiveHandError: the file cannot be read or written, or the format cannot hold its motion.
    """
    from ..motion.mano_basis import find_basis
    from ..motion.writers.registry import WRITERS, choose_writer
    from ..motion.writers.writer import WriteOptions

    read = read or take_of_file
    if export_splats.is_wanted(args):
        return export_splats.run(args, lambda args: export_splats.frames_of_take(args, read(args)))
    writer = choose_writer(args.output, args.format, writers or WRITERS)
    check_options(args, writer.name)
    texture_px = args.texture_size or WriteOptions.texture_px
    if texture_px > _MOST_TEXTURE_PX:
        raise LiveHandError(f"--texture-size must be at most {_MOST_TEXTURE_PX} px, got {texture_px}")
    take = read(args)
    basis = find_basis(args.mano, args.hand) if args.from_mean else None
    avatars: dict[Side, Path] = {side: args.avatar for side in SIDES} if args.avatar else {}
    options = WriteOptions(args.from_mean, basis, avatars, texture_px)
    losses = writer.write(take, args.output, options)
    for loss in losses:
        warn(f"livehand export: {args.output.name}: {loss}")
    sides = [hand.side for hand in take.hands]
    return {
        "output": str(args.output),
        "format": writer.name,
        "hands": sides,
        "frames": take.count,
        "fps": take.fps,
        "losses": list(losses),
        "summary": f"{args.output}: {take.count} frames of {' and '.join(sides)} as {writer.title}",
    }


def take_of_file(args: argparse.Namespace) -> Take:
    """Read a file of poses or landmarks, all its hands or the one that is asked for.

    Raises:
        LiveHandError: it cannot be read, does not say its rate, or lacks the hand.
    """
    from ..hand.model_file import DEFAULT_HAND, load_hand_model
    from ..motion.files.open_files import open_motion_file

    model = load_hand_model(args.hand or DEFAULT_HAND)
    file = open_motion_file(args.source)
    sides = [args.side] if args.side else list(file.sides)
    return joined([_taken(args, file, side, model) for side in sides], args)


def joined(hands: Sequence[TakenHand], args: argparse.Namespace) -> Take:
    """Join the hands of a file to a take of the rate that the file, or else the user, tells.

    Raises:
        LiveHandError: nobody tells the rate.
    """
    from ..motion.writers.take import take_of

    fps = args.fps or hands[0].motion.fps
    if fps is None:
        raise LiveHandError(f"{args.source} does not say its frames per second; give them (--fps 30)")
    return take_of([replace(hand, motion=replace(hand.motion, fps=fps)) for hand in hands], fps)


def _taken(args: argparse.Namespace, file: MotionFile, side: Side, model: HandModel) -> TakenHand:
    from ..motion.files.import_options import ImportOptions, motion_and_warning, with_options
    from ..motion.spaces import to_blender
    from ..motion.writers.take import TakenHand, moved

    options = ImportOptions({"side": side}, args.mano)
    chosen = with_options(file, options)
    motion, doubt = motion_and_warning(chosen, options, model, args.hand)
    if doubt:
        warn(f"livehand export: {args.source}: check the {side} hand: {doubt}")
    return TakenHand(moved(motion, model, to_blender(chosen.info.space)), model, first=chosen.info.first)


COMMAND = Command("export", "write a hand's motion for other programs, or onto a character", add_arguments, run)
