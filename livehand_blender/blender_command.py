"""`blender --command livehand render ...`: the `livehand` program's render, in a Blender that has the extension."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any, ClassVar

import bpy

from ..backend.runtime.command import Command, run_commands
from .render import command as render

_RENDER = Command(
    "render",
    "render the frames of .blend files with a hand",
    render.add_arguments,
    lambda args: render.run(args, in_blender=contextlib.nullcontext),
)


class BlenderCommand:
    """The command `livehand`, while it is registered."""

    handle: ClassVar[Any] = None

    @classmethod
    def register(cls) -> None:
        """Tell Blender of it."""
        cls.handle = bpy.utils.register_cli_command("livehand", run)

    @classmethod
    def unregister(cls) -> None:
        """A command that is left hangs Blender 4.5 as a module at exit."""
        bpy.utils.unregister_cli_command(cls.handle)
        cls.handle = None


def run(argv: Sequence[str]) -> int:
    """Run it with what follows its name on Blender's command line; returns the exit code."""
    return run_commands("livehand", "Photoreal frames of hands posed in Blender.", {_RENDER.name: _RENDER}, argv)
