"""Operators: each reads its properties, calls one function, and reports."""

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty
from mathutils import Matrix

from ...backend.hand.model import upright
from ...backend.hand.model_file import DEFAULT_HAND, load_hand_model
from ..hands.framing import frame_in_view
from ..light.studio import add_studio, needs_light
from ..render.memory import free_memory
from ..rig.build import add_hand
from ..rig.hand import RiggedHand
from ..rig.pose import write_theta, write_transl
from ..scene.settings import use_livehand
from .mixins import SIDES, OnHand, reports_errors


class LIVEHAND_OT_add_hand(bpy.types.Operator):
    """Add a hand that can be posed and rendered."""

    bl_idname = "livehand.add_hand"
    bl_label = "LiveHand Hand"
    bl_options = {"REGISTER", "UNDO"}

    side: EnumProperty(name="Side", items=SIDES, default="right")
    model_path: StringProperty(
        name="Hand Model",
        description="A hand in MANO's format (.npz, or MANO's own .pkl); empty for the built-in hand",
        subtype="FILE_PATH",
    )
    studio: BoolProperty(
        name="Studio Lights",
        description="Light it as a photographer would: key, fill and rim lights, and a dim world; proposed where the "
        "scene has no light",
    )
    frame: BoolProperty(name="Frame in View", description="Turn the 3D view to the new hand", default=True)

    @classmethod
    def poll(cls, context):
        """Enable it if the collection is local."""
        if context.collection.library is not None or context.scene.library is not None:
            cls.poll_message_set("The active collection is linked from another file; choose a local one")
            return False
        return True

    def invoke(self, context, event):
        """Propose Studio Lights where hands would be dark."""
        if not self.properties.is_property_set("studio"):
            self.studio = needs_light(context.scene, context.view_layer)
        return self.execute(context)

    @reports_errors
    def execute(self, context):
        """Add the hand at the 3D cursor, upright as the avatars' light requires."""
        path = bpy.path.abspath(self.model_path)
        model = load_hand_model(path or DEFAULT_HAND)
        armature = add_hand(context, model.for_side(self.side), self.model_path, f"{self.side.title()} Hand")
        armature.location = context.scene.cursor.location
        armature.rotation_euler = Matrix(upright(self.side).tolist()).to_euler()
        if self.studio:
            context.view_layer.update()
            add_studio(context, armature)
        context.view_layer.update()
        is_framed = self.frame and frame_in_view(context)
        self.report({"INFO"}, "Added a life-size hand" + ("" if is_framed else "; View > Frame Selected shows it"))


class LIVEHAND_OT_reset_pose(OnHand, bpy.types.Operator):
    """Return the hand to its rest pose; its shape is kept."""

    bl_idname = "livehand.reset_pose"
    bl_label = "Reset Hand Pose"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context):
        """Set theta and transl to zero."""
        hand = RiggedHand.active(context)
        write_theta(hand, np.zeros((16, 3)))
        write_transl(hand, np.zeros(3))


class LIVEHAND_OT_set_engine(bpy.types.Operator):
    """Set up the scene for LiveHand: its engine, the Standard view transform, and a transparent film."""

    bl_idname = "livehand.set_engine"
    bl_label = "Render with LiveHand"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Change the scene's render settings."""
        use_livehand(context.scene)
        return {"FINISHED"}


class LIVEHAND_OT_free_memory(bpy.types.Operator):
    """Unload the avatars and free their memory, including the GPU's; the next render loads them again."""

    bl_idname = "livehand.free_memory"
    bl_label = "Free Memory"
    bl_options = {"INTERNAL"}

    def execute(self, context):
        """Free the memory."""
        free_memory()
        return {"FINISHED"}


CLASSES = (
    LIVEHAND_OT_add_hand,
    LIVEHAND_OT_reset_pose,
    LIVEHAND_OT_set_engine,
    LIVEHAND_OT_free_memory,
)
