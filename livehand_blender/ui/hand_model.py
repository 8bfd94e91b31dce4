"""The operator that makes a hand model of a skinned mesh, and its panel."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ...backend.records.errors import LiveHandError
from ..retarget.character_file import joint_map_of
from ..retarget.hand_from_mesh import make_own_hand
from .active_hand import Tab

_SIDES = (
    ("auto", "As the Bones Tell", "The hand that more bones are found of"),
    ("right", "Right", "The right hand"),
    ("left", "Left", "The left hand; its file must have 'left' in its name"),
)


class LIVEHAND_OT_make_hand_model(bpy.types.Operator, ExportHelper):
    """Make a hand model (.npz) of the active skinned mesh, to capture and train on, and a .blend of its look."""

    bl_idname = "livehand.make_hand_model"
    bl_label = "Make Hand Model"
    bl_options = {"REGISTER"}

    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})
    side: EnumProperty(name="Side", description="Which hand of the character", items=_SIDES)
    scale: FloatProperty(
        name="Scale", description="Multiplied by this, the scene's lengths are meters", default=1.0, min=1e-6
    )
    bones: StringProperty(
        name="Bones",
        description="JSON that says which bone is which joint; empty: guess by names and shape",
        subtype="FILE_PATH",
    )

    @classmethod
    def poll(cls, context):
        """A mesh with an armature, in Object Mode."""
        thing = context.active_object
        if thing is None or thing.type != "MESH" or thing.find_armature() is None:
            cls.poll_message_set("select a mesh that an armature moves first")
            return False
        if thing.mode != "OBJECT":
            cls.poll_message_set("leave the mesh's mode for Object Mode first")
            return False
        return True

    def execute(self, context):
        """Write both files."""
        mesh = context.active_object
        armature = mesh.find_armature()
        try:
            bones = Path(bpy.path.abspath(self.bones)) if self.bones else None
            joint_map = joint_map_of(armature, None if self.side == "auto" else self.side, bones)
            path = Path(bpy.path.abspath(self.filepath))
            made = make_own_hand(context, mesh, armature, joint_map, path, self.scale)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Wrote {path.name} ({made['vertices']} vertices) and {Path(made['look']).name}")
        return {"FINISHED"}


class LIVEHAND_PT_hand_model(Tab, bpy.types.Panel):
    """A hand model of one's own."""

    bl_label = "Own Hand"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """The one step that is done in Blender."""
        self.layout.operator("livehand.make_hand_model", icon="MESH_DATA")


CLASSES = (LIVEHAND_OT_make_hand_model, LIVEHAND_PT_hand_model)
