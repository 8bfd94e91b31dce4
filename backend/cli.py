"""The commands that need no Blender: one table, which the `livehand` program joins with Blender's own."""

from __future__ import annotations

from .command import Command

COMMANDS: dict[str, Command] = {}
