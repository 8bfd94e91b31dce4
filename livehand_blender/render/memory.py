"""Frees the memory of loaded avatars: on demand, and after a render in Blender's window."""

from __future__ import annotations

import sys

import bpy
from bpy.app.handlers import persistent

from ..scene.handlers import add_handlers, remove_handlers
from .engine import LiveHandRender
from .viewport_shared import rendered_views


def free_memory() -> None:
    """Free all loaded avatars and hands, and torch's cached GPU memory. The next render loads them again."""
    LiveHandRender.required_session().free()
    torch = sys.modules.get("torch")
    if torch is not None and torch.cuda.is_initialized():
        torch.cuda.empty_cache()


@persistent
def _after_render(scene: bpy.types.Scene, *_) -> None:
    """Free the avatars, unless a view shows them, which would load them again at once."""
    if scene.livehand.free_after_render and not rendered_views():
        free_memory()


_WATCHED = (("render_complete", _after_render), ("render_cancel", _after_render))


def watch_renders() -> None:
    """Free memory after each render or animation, finished or cancelled, unless Blender runs without a window."""
    if not bpy.app.background:
        add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_renders`."""
    remove_handlers(_WATCHED)
