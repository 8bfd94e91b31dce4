"""Paths as Blender takes them: `//` at the start means the .blend's folder to it, braces a variable."""

from __future__ import annotations

from pathlib import Path

import bpy

# The first version of Blender that reads {name} in an output path as a variable.
_PATH_TEMPLATES = (4, 5, 0)


def operator_path(path: Path) -> str:
    """Make a path absolute for Blender's operators and functions; `//out`, which POSIX allows, becomes `/out`."""
    path = path.absolute()
    return str(Path("/", *path.parts[1:]) if path.anchor == "//" else path)


def output_path(path: Path) -> str:
    """Make a path absolute for Blender's output settings, with its braces escaped."""
    text = operator_path(path)
    return text.replace("{", "{{").replace("}", "}}") if bpy.app.version >= _PATH_TEMPLATES else text
