"""Functions that Blender calls at its events: put among its handlers, and taken out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bpy

Watched = Sequence[tuple[str, Callable[..., Any]]]
"""(list in `bpy.app.handlers`, function)."""


def add_handlers(watched: Watched) -> None:
    """Have the functions called from now on."""
    for name, function in watched:
        getattr(bpy.app.handlers, name).append(function)


def remove_handlers(watched: Watched) -> None:
    """Undo `add_handlers`; functions that are not there any more are left out."""
    for name, function in watched:
        handlers = getattr(bpy.app.handlers, name)
        if function in handlers:
            handlers.remove(function)
