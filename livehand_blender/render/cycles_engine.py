"""Cycles' render engine as a base class for ours: its viewport preview and its final render.

The class cannot derive from `CyclesRender`: registering a class whose base is registered as well takes the base's
Python class away from Blender, and the engine Cycles renders black from then on ("unable to get Python class for RNA
struct 'CYCLES'", Blender 4.3 and 4.5). So it borrows the functions of `CyclesRender`.
"""

from __future__ import annotations

import contextlib

import bpy
from cycles import CyclesRender


class CyclesEngine(bpy.types.RenderEngine):
    """Renders what Cycles renders. It is not registered itself."""

    bl_use_eevee_viewport = True

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.session = None  # Cycles' own

    def __del__(self):
        # Blender has freed an engine that Python kept longer, as the traceback of a logged error does.
        with contextlib.suppress(ReferenceError):
            CyclesRender.__del__(self)

    update = CyclesRender.update
    render = CyclesRender.render
    render_frame_finish = CyclesRender.render_frame_finish
    view_update = CyclesRender.view_update
    view_draw = CyclesRender.view_draw
    update_render_passes = CyclesRender.update_render_passes
