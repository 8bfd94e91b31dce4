"""The 3D views that show our engine, found in Blender's windows."""

from __future__ import annotations

import bpy

from ...scene.settings import ENGINE


def stop_rendered_views() -> None:
    """Set the views that our engine draws to Solid, which frees their engines at once.

    Unregistering the class would free them as well, but in the middle of Blender's own list of engines, while Cycles'
    thread may wait for Python.
    """
    for window in bpy.context.window_manager.windows:
        if window.scene.render.engine == ENGINE:
            for area in window.screen.areas:
                for space in area.spaces:
                    if space.type == "VIEW_3D" and space.shading.type == "RENDERED":
                        space.shading.type = "SOLID"
