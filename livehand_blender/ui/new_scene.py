"""A first picture in one click: a hand that is framed and lit, its camera and engine, and a Rendered view."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty
from mathutils import Matrix

from ...backend.hand.model import upright
from ...backend.hand.model_file import load_default_hand
from ..hands.framing import add_framing_camera, views_of
from ..light.studio import add_studio
from ..rig.build import add_hand
from ..rig.hand import RiggedHand
from ..scene.settings import use_livehand
from .mixins import SIDES, reports_errors

# What a new file of Blender's holds.
_DEFAULT_OBJECTS = {("Camera", "CAMERA"), ("Cube", "MESH"), ("Light", "LIGHT")}
_CUBE_CORNERS = 8


class LIVEHAND_OT_new_hand_scene(bpy.types.Operator):
    """Make a scene with a hand, a camera that frames it, Studio Lights and LiveHand's engine, and show it rendered."""

    bl_idname = "livehand.new_hand_scene"
    bl_label = "New Hand Scene"
    bl_options = {"REGISTER", "UNDO"}

    side: EnumProperty(name="Side", items=SIDES, default="right")

    @reports_errors
    def execute(self, context):
        """Fill an empty scene, or that of a new file; beside a scene with other objects, make a new one."""
        window = context.window
        scene = _free_scene(context.scene)
        if window is not None:
            window.scene = scene
        layer = scene.view_layers[0]
        with context.temp_override(scene=scene, view_layer=layer, collection=scene.collection):
            armature = add_hand(bpy.context, load_default_hand().for_side(self.side), "", f"{self.side.title()} Hand")
            armature.rotation_euler = Matrix(upright(self.side).tolist()).to_euler()
            layer.update()
            add_framing_camera(scene, RiggedHand.of(armature), bpy.context.evaluated_depsgraph_get())
            layer.update()
            add_studio(bpy.context, armature)
        use_livehand(scene)
        for space in views_of(window) if window is not None else ():
            space.region_3d.view_perspective = "CAMERA"
            space.shading.type = "RENDERED"
            space.show_region_ui = True


def _free_scene(scene: bpy.types.Scene) -> bpy.types.Scene:
    """Return the scene if nothing of the user's is in it, without a new file's own objects; else a new one."""
    if _is_of_new_file(scene):
        for thing in list(scene.objects):
            bpy.data.batch_remove([thing, thing.data])
    if len(scene.objects) or scene.library is not None:
        return bpy.data.scenes.new("Hand")
    return scene


def _is_of_new_file(scene: bpy.types.Scene) -> bool:
    """Return whether a scene holds what Blender puts into a new file, untouched as far as can be seen."""
    found = {(thing.name, thing.type) for thing in scene.objects}
    if found != _DEFAULT_OBJECTS or bpy.data.filepath:
        return False
    cube = scene.objects["Cube"]
    is_plain = not cube.modifiers and not cube.animation_data and cube.matrix_world == Matrix()
    return is_plain and len(cube.data.vertices) == _CUBE_CORNERS and not scene.objects["Camera"].animation_data


CLASSES = (LIVEHAND_OT_new_hand_scene,)
