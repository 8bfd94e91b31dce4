"""Cycles' render engine as a base class for ours: its preview of the scene, its final render.

Deriving from `CyclesRender` itself would do, but registering a class whose base is registered as well takes that base's
Python class away from Blender: the engine Cycles would render black from then on ("unable to get Python class for RNA
struct 'CYCLES'", Blender 4.3 and 4.5). So its functions are borrowed.
"""

from __future__ import annotations

import contextlib

import bpy
from cycles import CyclesRender


class CyclesEngine(bpy.types.RenderEngine):
    """Renders what Cycles renders. Not registered itself."""

    bl_use_eevee_viewport = True

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.session = None  # Cycles' own

    def __del__(self):
        # Blender has taken an engine apart that Python kept longer, as a logged error's traceback does.
        with contextlib.suppress(ReferenceError):
            CyclesRender.__del__(self)

    update = CyclesRender.update
    render = CyclesRender.render
    render_frame_finish = CyclesRender.render_frame_finish
    view_update = CyclesRender.view_update
    view_draw = CyclesRender.view_draw
    update_render_passes = CyclesRender.update_render_passes
