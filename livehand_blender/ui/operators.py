"""Operators: each reads its properties, calls one function, and reports."""

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty
from mathutils import Matrix

from ...backend.hand.model import HandModel, upright
from ...backend.hand.model_file import load_default_hand, load_hand_model
from ...backend.records.errors import LiveHandError
from ...backend.runtime.dependencies import install_command, missing_requirements
from ..render.hands.renderer_loading import packages_folder
from ..render.memory import free_memory
from ..rig.hand import add_hand
from ..rig.pose import write_theta, write_transl
from ..scene.settings import use_livehand
from .active_hand import OnHand, active_hand


def load_hand(path: str) -> HandModel:
    """The model at a path, `//` allowed, or the built-in hand for none.

    Raises:
        LiveHandError: the file is no hand model.
    """
    return load_hand_model(bpy.path.abspath(path)) if path else load_default_hand()


class LIVEHAND_OT_add_hand(bpy.types.Operator):
    """Add a hand that can be posed and rendered."""

    bl_idname = "livehand.add_hand"
    bl_label = "LiveHand Hand"
    bl_options = {"REGISTER", "UNDO"}

    side: EnumProperty(
        name="Side", items=(("right", "Right", "A right hand"), ("left", "Left", "A left hand")), default="right"
    )
    model_path: StringProperty(
        name="Hand Model",
        description="A hand in MANO's format (.npz, or MANO's own .pkl); empty for the built-in hand",
        subtype="FILE_PATH",
    )

    @classmethod
    def poll(cls, context):
        """A hand needs a collection it can be edited in."""
        if context.collection.library is not None or context.scene.library is not None:
            cls.poll_message_set("the active collection is linked from another file; choose a local one")
            return False
        return True

    def execute(self, context):
        """Add the hand at the 3D cursor, upright, as the avatars' light is meant for."""
        try:
            armature = add_hand(context, load_hand(self.model_path).for_side(self.side), self.model_path)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        armature.location = context.scene.cursor.location
        armature.rotation_euler = Matrix(upright(self.side).tolist()).to_euler()
        self.report({"INFO"}, "Added a hand of life size; View > Frame Selected shows it")
        return {"FINISHED"}


class LIVEHAND_OT_reset_pose(OnHand, bpy.types.Operator):
    """Put the hand back into its rest pose; its shape is kept."""

    bl_idname = "livehand.reset_pose"
    bl_label = "Reset Hand Pose"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Zero theta and transl."""
        try:
            write_theta(active_hand(context), np.zeros((16, 3)))
            write_transl(active_hand(context), np.zeros(3))
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LIVEHAND_OT_set_engine(bpy.types.Operator):
    """Render with LiveHand: its engine, Standard view transform, transparent film."""

    bl_idname = "livehand.set_engine"
    bl_label = "Render with LiveHand"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Change the scene's render settings."""
        use_livehand(context.scene)
        return {"FINISHED"}


class LIVEHAND_OT_copy_install_command(bpy.types.Operator):
    """Copy the command that installs the missing Python packages; LiveHand runs nothing itself."""

    bl_idname = "livehand.copy_install_command"
    bl_label = "Copy Install Command"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Only while something is missing."""
        if not missing_requirements():
            cls.poll_message_set("nothing is missing")
            return False
        return True

    def execute(self, context):
        """Put the command on the clipboard, and show it."""
        command = install_command(missing_requirements(), packages_folder())
        context.window_manager.clipboard = command
        self.report({"INFO"}, f"Copied: {command}")
        return {"FINISHED"}


class LIVEHAND_OT_free_memory(bpy.types.Operator):
    """Forget the loaded avatars and give their memory back, the GPU's too; the next render loads them again."""

    bl_idname = "livehand.free_memory"
    bl_label = "Free Memory"
    bl_options = {"INTERNAL"}

    def execute(self, context):
        """Free it."""
        free_memory()
        return {"FINISHED"}


CLASSES = (
    LIVEHAND_OT_add_hand,
    LIVEHAND_OT_reset_pose,
    LIVEHAND_OT_set_engine,
    LIVEHAND_OT_free_memory,
    LIVEHAND_OT_copy_install_command,
)
