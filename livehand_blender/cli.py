"""The `livehand` program: the table of its commands.

Only `render`, `make-hand`, `capture`, `lookdev`, and `inspect` and `export` of a rig's file need Blender as a module,
and `benchmark` uses it for Cycles; they import it when they run.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ..backend.capture.masks.mask_command import COMMAND as MASK
from ..backend.commands import export, export_splats
from ..backend.commands import render_motion as render_poses
from ..backend.commands.export import COMMAND as EXPORT
from ..backend.commands.export_options import BLEND, POSES, RIG, RIG_FILE, check_options, check_source
from ..backend.commands.extract_mesh.command import COMMAND as EXTRACT_MESH
from ..backend.commands.import_interhand import COMMAND as IMPORT_INTERHAND
from ..backend.commands.import_transforms import COMMAND as IMPORT_TRANSFORMS
from ..backend.commands.inspect import COMMAND as INSPECT
from ..backend.commands.inspect import report
from ..backend.commands.origin import COMMAND as ORIGIN
from ..backend.commands.reenact.command import COMMAND as REENACT
from ..backend.commands.sign import COMMAND as SIGN
from ..backend.commands.track import COMMAND as TRACK
from ..backend.commands.warm_up import COMMAND as WARM_UP
from ..backend.commands.watermark_command import COMMAND as WATERMARK
from ..backend.evaluation.command import COMMAND as EVALUATE
from ..backend.evaluation.perceptual.fetch_command import COMMAND as FETCH_PERCEPTUAL
from ..backend.evaluation.sheet_command import COMMAND as SHEET
from ..backend.motion.document import SUFFIXES as POSE_FILES
from ..backend.person.command import COMMAND as PERSON
from ..backend.person.invented.adjust_command import COMMAND as ADJUST_PERSON
from ..backend.person.invented.command import COMMAND as NEW_PERSON
from ..backend.records.errors import LiveHandError
from ..backend.render.thumbnail_command import COMMAND as THUMBNAIL
from ..backend.rigs.rig_suffixes import RIG_SUFFIXES
from ..backend.system.command import Command, blender_silenced, run_commands, warn
from ..backend.tracking.fetch_command import COMMAND as FETCH_TRACKER
from ..backend.training.command import COMMAND as TRAIN
from ..backend.training.identity_command import COMMAND as IDENTITY
from .capture import command as capture
from .render import command as render
from .rigs import command as make_hand
from .rigs import export_sources, rig_motion

ABOUT = "Photoreal frames of hands posed in Blender."

Run = Callable[[argparse.Namespace], Mapping[str, Any]]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    return run_commands("livehand", ABOUT, COMMANDS, argv)


def _add_render_arguments(parser: argparse.ArgumentParser) -> None:
    render.add_arguments(parser)
    render_poses.add_arguments(parser)


def _render(args: argparse.Namespace) -> Mapping[str, Any]:
    """Render .blend files with Blender, or a pose file without it."""
    if args.worker is None and _compiles_first():
        warn("livehand render: the first frame compiles kernels, once on a machine, for a minute or more")
    suffix = args.shots[0].suffix.lower()
    if suffix in POSE_FILES:
        return render_poses.run(args)
    if suffix in RIG_SUFFIXES:
        read = partial(rig_motion.read_upright, side=args.side)
        return _in_blender(partial(render_poses.run, read=read))(args)
    if args.identity:
        raise LiveHandError(
            "--identity is of pose files, got a .blend; write the person as an avatar with livehand identity, "
            "and give that with --avatar"
        )
    return _in_blender(partial(render.run, in_blender=_registered))(args)


def _compiles_first() -> bool:
    """Return whether no kernel has been compiled on this machine, and numba is there to do so."""
    from ..backend.compute.kernels.cache_folder import has_kernels

    return importlib.util.find_spec("numba") is not None and not has_kernels()


def _inspect(args: argparse.Namespace) -> Mapping[str, Any]:
    """Inspect an animated rig with Blender's importers, any other file without Blender."""
    if args.file.is_file() and args.file.suffix.lower() in RIG_SUFFIXES:
        return _silent_in_blender(lambda args: report(rig_motion.rig_facts(args.file)))(args)
    return INSPECT.run(args)


def _export(args: argparse.Namespace) -> Mapping[str, Any]:
    """Export with Blender's importers and exporters where the source, the format or --rig needs them."""
    source, is_scene = args.source.suffix.lower(), args.source.suffix.lower() == ".blend"
    check_source(args, BLEND if is_scene else RIG_FILE if source in RIG_SUFFIXES else POSES)
    is_blenders = args.output.suffix.lower() in export.BLENDER_SUFFIXES and not export_splats.is_wanted(args)
    needs = args.rig or is_scene or source in RIG_SUFFIXES or is_blenders
    return (
        _silent_in_blender(partial(_export_in_blender, is_scene, source in RIG_SUFFIXES))(args)
        if needs
        else EXPORT.run(args)
    )


def _export_in_blender(is_scene: bool, is_rig: bool, args: argparse.Namespace) -> Mapping[str, Any]:
    from .rigs.blender_writers import ALL_WRITERS

    read = export_sources.take_of_blend if is_scene else export_sources.take_of_rig if is_rig else export.take_of_file
    with _registered():
        if args.rig and not export_splats.is_wanted(args):
            check_options(args, RIG)
            return export_sources.send_to_character(args, read(args))
        if is_scene and export_splats.is_wanted(args):
            return export_splats.run(args, _splat_frames)
        return export.run(args, read, ALL_WRITERS)


def _splat_frames(args: argparse.Namespace) -> export_splats.Frames:
    """Read the hands of a .blend's scene in its frames and its light."""
    import bpy

    from .render.frame_setup import lit_frames
    from .rigs.character_file import open_blend

    if args.avatar:
        raise LiveHandError("--avatar is of a file of poses, got a .blend, whose hands have their own; leave it out")
    open_blend(args.source)
    scene = bpy.context.scene
    frames = args.frames or range(scene.frame_start, scene.frame_end + 1)
    return lit_frames(bpy.context, frames, lambda hand: args.side in (None, hand.shot.pose.side))


def _in_blender(run: Run) -> Run:
    """Wrap the function in a check that Blender's module is installed."""

    def run_in_blender(args: argparse.Namespace) -> Mapping[str, Any]:
        if importlib.util.find_spec("bpy") is None:
            raise LiveHandError(
                'this command needs Blender as a Python module; install it with: pip install "livehand[bpy]"'
            )
        with blender_silenced():  # Blender 5.2 says where OCIO points
            importlib.import_module("bpy")
        return run(args)

    return run_in_blender


def _silent_in_blender(run: Run) -> Run:
    """Wrap the function to run without Blender's own output."""
    return _in_blender(blender_silenced()(run))


@contextlib.contextmanager
def _registered() -> Iterator[None]:
    """Register LiveHand's classes within; it leaves those of a caller registered."""
    import bpy

    from .. import register, unregister

    if hasattr(bpy.types.Scene, "livehand"):
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()


def _optional(module: str) -> tuple[Command, ...]:
    """Return the commands of a module that not every installation has."""
    name = f"{str(__package__).removesuffix('livehand_blender')}{module}"
    try:
        return importlib.import_module(name).COMMANDS
    except ModuleNotFoundError as missing:
        if missing.name is None or not f"{name}.".startswith(f"{missing.name}."):
            raise
        return ()


COMMANDS: dict[str, Command] = {
    command.name: command
    for command in (
        Command("render", "render the frames of .blend files, or of a pose file", _add_render_arguments, _render),
        Command(
            "make-hand",
            "make a hand model of a skinned mesh, to capture and train on",
            make_hand.add_arguments,
            _silent_in_blender(make_hand.run),
        ),
        Command(
            "capture",
            "render multi-view images of the built-in hand, or of one of your own, to train on",
            capture.add_arguments,
            _silent_in_blender(capture.run),
        ),
        TRAIN,
        IDENTITY,
        PERSON,
        NEW_PERSON,
        ADJUST_PERSON,
        EVALUATE,
        WARM_UP,
        SHEET,
        replace(INSPECT, run=_inspect),
        replace(EXPORT, run=_export),
        THUMBNAIL,
        IMPORT_INTERHAND,
        IMPORT_TRANSFORMS,
        MASK,
        FETCH_TRACKER,
        FETCH_PERCEPTUAL,
        TRACK,
        REENACT,
        EXTRACT_MESH,
        ORIGIN,
        WATERMARK,
        SIGN,
        *_optional("livehand_blender.research.commands"),
        *(replace(command, run=_silent_in_blender(command.run)) for command in _optional("tools.commands")),
    )
}
