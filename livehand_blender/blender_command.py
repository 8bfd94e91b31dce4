"""`blender --command livehand ...`: in the Blender program, the commands `render` and `fetch-tracker` of `livehand`."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any, ClassVar

import bpy

from ..backend.system.command import Command, run_commands
from ..backend.tracking.fetch_command import COMMAND as FETCH_TRACKER
from .render import command as render

_RENDER = Command(
    "render",
    "render the frames of .blend files with a hand",
    render.add_arguments,
    lambda args: render.run(args, in_blender=contextlib.nullcontext),
)

_COMMANDS = {command.name: command for command in (_RENDER, FETCH_TRACKER)}


class BlenderCommand:
    """The command `livehand`, while it is registered."""

    handle: ClassVar[Any] = None

    @classmethod
    def register(cls) -> None:
        """Register the command with Blender."""
        cls.handle = bpy.utils.register_cli_command("livehand", run)

    @classmethod
    def unregister(cls) -> None:
        """Unregister it: a command that stays registered hangs Blender 4.5 as a module at exit."""
        bpy.utils.unregister_cli_command(cls.handle)
        cls.handle = None


def run(argv: Sequence[str]) -> int:
    """Run the command with the arguments after its name on Blender's command line; returns the exit code."""
    return run_commands(
        "livehand",
        "Photoreal frames of hands posed in Blender.",
        _COMMANDS,
        argv,
    )
