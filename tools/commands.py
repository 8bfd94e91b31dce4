"""The commands of `livehand` that only a checkout has; each needs Blender as a module."""

from .lookdev.command import COMMAND as LOOKDEV

COMMANDS = (LOOKDEV,)
