"""Blender's own panels that stay useful with the LIVEHAND engine, and the choice of passes."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene.settings import ENGINE

# Panels of features that a hand-only render does not have.
_EXCLUDED = ("VIEWLAYER_PT_freestyle", "RENDER_PT_freestyle", "RENDER_PT_simplify_greasepencil")


class LIVEHAND_PT_passes(bpy.types.Panel):
    """View layer tab: the passes beside Combined."""

    bl_label = "Passes"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """Only with our engine."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        """One switch."""
        self.layout.use_property_split = True
        self.layout.prop(context.view_layer, "use_pass_z", text="Depth")


def register_panels() -> None:
    """Show the panels that any engine has: output, format, colour management, lens, ..."""
    for panel in _general_panels():
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister_panels() -> None:
    """Take our engine out of all of them."""
    for panel in _general_panels():
        panel.COMPAT_ENGINES.discard(ENGINE)


def _general_panels() -> Iterator[type]:
    for panel in bpy.types.Panel.__subclasses__():
        if "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ()) and not panel.__name__.startswith(_EXCLUDED):
            yield panel
