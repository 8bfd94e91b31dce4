"""Blender's and Cycles' own panels, which stay useful with the LIVEHAND engine, and the choice of our passes."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene.settings import ENGINE

# Panels of features that we do not have.
_EXCLUDED = (
    "VIEWLAYER_PT_freestyle",
    "RENDER_PT_freestyle",
    "RENDER_PT_simplify_greasepencil",
    "CYCLES_RENDER_PT_bake",
)
# Panels of any engine, and Cycles' own: it renders the scene around a hand, and its light and material settings count.
_ENGINES_ALIKE = {"BLENDER_RENDER", "CYCLES"}


class LIVEHAND_PT_passes(bpy.types.Panel):
    """View layer tab: the passes beside Blender's own."""

    bl_label = "Hand Passes"
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
        self.layout.prop(context.view_layer.livehand, "use_pass_hand", text="Hand and HandAlpha")


def register_panels() -> None:
    """Show the panels that any engine has, such as output, format and lens, and Cycles' own."""
    for panel in _general_panels():
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister_panels() -> None:
    """Take our engine out of all of them."""
    for panel in _general_panels():
        panel.COMPAT_ENGINES.discard(ENGINE)


def _general_panels() -> Iterator[type]:
    for panel in bpy.types.Panel.__subclasses__():
        is_useful = not _ENGINES_ALIKE.isdisjoint(getattr(panel, "COMPAT_ENGINES", ()))
        if is_useful and not panel.__name__.startswith(_EXCLUDED):
            yield panel
