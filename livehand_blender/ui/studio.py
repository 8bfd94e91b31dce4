"""Operators of the studio set-up."""

import bpy

from ..light.studio import add_studio, has_studio, needs_light, remove_studio
from ..rig.hand import active_hand
from .mixins import reports_errors


class LIVEHAND_OT_add_studio(bpy.types.Operator):
    """Light the hand as a photographer would, from where the camera is: key, fill and rim lights, and a dim world."""

    bl_idname = "livehand.add_studio"
    bl_label = "Studio Lights"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Enable it if the scene is local."""
        if context.scene.library is not None:
            cls.poll_message_set("The scene is linked from another file; make it local first")
            return False
        return True

    @reports_errors
    def execute(self, context):
        """Add the set-up, in place of an earlier one."""
        add_studio(context, active_hand(context))


class LIVEHAND_OT_remove_studio(bpy.types.Operator):
    """Remove the studio's lights, and bring back the world before it."""

    bl_idname = "livehand.remove_studio"
    bl_label = "Remove Studio Lights"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Enable it if there is a studio."""
        return has_studio(context.scene)

    def execute(self, context):
        """Remove the set-up."""
        remove_studio(context.scene)
        return {"FINISHED"}


def draw_studio(layout: bpy.types.UILayout, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Draw the buttons, if the scene's light falls on the hands, and say so if there is hardly any."""
    if scene.livehand.light == "SCENE":
        if needs_light(scene, view_layer):
            layout.label(text="No Light: Hands Are Dark", icon="INFO")
        row = layout.row(align=True)
        row.operator("livehand.add_studio", icon="LIGHT_AREA")
        if has_studio(scene):
            row.operator("livehand.remove_studio", text="", icon="X")


CLASSES = (LIVEHAND_OT_add_studio, LIVEHAND_OT_remove_studio)
