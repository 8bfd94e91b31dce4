"""The panels of Blender and Cycles that also apply to the LIVEHAND engine, and the panels of its own."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene.settings import ENGINE

# Panels of features that LIVEHAND lacks.
_EXCLUDED = (
    "VIEWLAYER_PT_freestyle",
    "RENDER_PT_freestyle",
    "RENDER_PT_simplify_greasepencil",
    "CYCLES_RENDER_PT_bake",
)


class LIVEHAND_PT_passes(bpy.types.Panel):
    """View Layer tab: the passes that Blender does not have."""

    bl_label = "Hand Passes"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """Show it with the LIVEHAND engine only."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        """Draw the switches."""
        self.layout.use_property_split = True
        self.layout.prop(context.view_layer.livehand, "use_pass_hand", text="Hand and HandAlpha")
        self.layout.prop(context.view_layer.livehand, "use_pass_fade", text="HandFade")


class LIVEHAND_PT_hand_light(bpy.types.Panel):
    """Render tab: what a frame shows, and what lights the hands."""

    bl_label = "Hands"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """Show it with the LIVEHAND engine only."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        """Draw the two choices."""
        self.layout.use_property_split = True
        draw_mode(self.layout, context.scene)
        self.layout.prop(context.scene.livehand, "light")


def draw_mode(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw what a frame shows; and, where a transparent film takes away the world that a scene has, its switch."""
    layout.prop(scene.livehand, "mode")
    if scene.livehand.mode == "SCENE" and scene.render.film_transparent:
        box = layout.box()
        box.label(text="World Hidden by Film", icon="INFO")
        box.prop(scene.render, "film_transparent", text="Transparent Film")


def register_panels() -> None:
    """Show the general panels, such as output, format and lens, and those of Cycles."""
    for panel in _general_panels():
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister_panels() -> None:
    """Hide them again."""
    for panel in bpy.types.Panel.__subclasses__():
        if not panel.__name__.startswith("LIVEHAND"):
            getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)


def _general_panels() -> Iterator[type]:
    """Yield the panels of Cycles, which renders the scene around a hand; without it those of Blender.

    Cycles' are both its own and those of Blender that it does not replace: the others would be there twice.
    """
    of_engine: dict[str, list[type]] = {"CYCLES": [], "BLENDER_RENDER": []}
    for panel in bpy.types.Panel.__subclasses__():
        for engine, panels in of_engine.items():
            if engine in getattr(panel, "COMPAT_ENGINES", ()) and not panel.__name__.startswith(_EXCLUDED):
                panels.append(panel)
    yield from of_engine["CYCLES"] or of_engine["BLENDER_RENDER"]
