"""The operator that makes a hand model from a skinned mesh, and its panel."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..rigs.character_file import read_joint_map
from ..rigs.hand_from_mesh import hand_model_from_mesh
from .mixins import AdvancedTab, reports_errors

_SIDES = (
    ("auto", "Automatic", "The hand for which more bones are found"),
    ("right", "Right", "The right hand"),
    ("left", "Left", "The left hand; its file must have 'left' in its name"),
)


class LIVEHAND_OT_make_hand_model(bpy.types.Operator, ExportHelper):
    """Make a hand model (.npz) from the active skinned mesh, for captures and training, and a .blend of its look."""

    bl_idname = "livehand.make_hand_model"
    bl_label = "Make Hand Model"
    bl_options = {"REGISTER"}

    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})
    side: EnumProperty(name="Side", description="Which hand of the character", items=_SIDES)
    scale: FloatProperty(name="Scale", description="Factor from the scene's lengths to meters", default=1.0, min=1e-6)
    bones: StringProperty(
        name="Bones",
        description="JSON file that names the bone of each joint; empty: guess by names and shape",
        subtype="FILE_PATH",
    )

    @classmethod
    def poll(cls, context):
        """Enable it on a mesh with an armature, in Object Mode."""
        mesh = context.active_object
        if mesh is None or mesh.type != "MESH" or mesh.find_armature() is None:
            cls.poll_message_set("Select a mesh that is deformed by an armature first")
            return False
        if mesh.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        return True

    @reports_errors
    def execute(self, context):
        """Write both files."""
        mesh = context.active_object
        armature = mesh.find_armature()
        bones = Path(bpy.path.abspath(self.bones)) if self.bones else None
        joint_map = read_joint_map(armature, None if self.side == "auto" else self.side, bones)
        path = Path(bpy.path.abspath(self.filepath))
        # The file browser has asked before it replaces a file.
        made = hand_model_from_mesh(context, mesh, armature, joint_map, path, self.scale, overwrites=True)
        missing = [PureWindowsPath(name).name for name in made["pictures_missing"]]
        for doubt in (made["doubt"], missing and f"plain colors replace missing images: {', '.join(missing)}"):
            if doubt:
                self.report({"WARNING"}, f"Check the hand: {doubt}")
        self.report({"INFO"}, f"Wrote {path.name} ({made['vertices']} vertices) and {Path(made['look']).name}")


class LIVEHAND_PT_hand_model(AdvancedTab, bpy.types.Panel):
    """A hand model made from your own mesh."""

    bl_label = "Custom Hand"

    def draw(self, context):
        """Draw the operator."""
        self.layout.operator("livehand.make_hand_model", icon="MESH_DATA")


CLASSES = (LIVEHAND_OT_make_hand_model, LIVEHAND_PT_hand_model)
