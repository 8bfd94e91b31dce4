"""The panel *Other Rig*: a hand driven by an armature made elsewhere, live or baked."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, IntProperty

from ...backend.hand.bones import FINGERS as SHOWN_FINGERS
from ...backend.hand.model import JOINT_NAMES, MANO_FINGERS
from ...backend.records.errors import LiveHandError
from ...backend.retarget.joint_guess import guess_joints
from ...backend.retarget.source_skeleton import JointMap
from ..retarget.bake import bake
from ..retarget.follow import check_editable, follow, is_following, stop_following
from ..retarget.skeleton import read_skeleton
from ..rig.retarget_properties import tip_property
from .active_hand import HandTab, OnHand, active_hand, model_of, polled_hand


def _has_rig(hand: bpy.types.Object) -> bool:
    """Whether an armature is chosen; scripts, and the field in Blender 4.2, take any object."""
    source = hand.livehand.other_rig.armature
    return source is not None and source.type == "ARMATURE"


class _OnRig(OnHand):
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Only on a hand for which an armature is chosen."""
        if not super().poll(context):
            return False
        if not _has_rig(polled_hand(context)):
            cls.poll_message_set("choose the other rig's armature first")
            return False
        return True


class LIVEHAND_OT_guess_bones(_OnRig, bpy.types.Operator):
    """Find the hand's bones in the other rig by their names, or else by their shape."""

    bl_idname = "livehand.guess_bones"
    bl_label = "Guess Bones"

    def execute(self, context):
        """Fill in the fields."""
        hand = polled_hand(context).livehand
        guess = guess_joints(read_skeleton(hand.other_rig.armature), _side(hand))
        for joint, bone in zip(JOINT_NAMES, guess.bones, strict=True):
            setattr(hand.other_rig, joint, bone or "")
        for finger, bone in zip(MANO_FINGERS, guess.tips, strict=True):
            setattr(hand.other_rig, tip_property(finger), bone or "")
        if guess.missing:
            self.report({"WARNING"}, f"No bones of a {guess.side} hand were found for {', '.join(guess.missing)}")
        else:
            self.report({"INFO"}, f"Found the {guess.side} hand of {hand.other_rig.armature.name}")
        return {"FINISHED"}


class LIVEHAND_OT_follow_rig(_OnRig, bpy.types.Operator):
    """Let the hand follow the other rig live, by constraints on hidden bones."""

    bl_idname = "livehand.follow_rig"
    bl_label = "Follow"

    def execute(self, context):
        """Add the constraints."""
        armature = polled_hand(context)
        rig = armature.livehand.other_rig
        try:
            model, _ = model_of(armature)
            follow(context, armature, model, rig.armature, _joint_map(armature), rig.fits_shape)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LIVEHAND_OT_bake_rig(_OnRig, bpy.types.Operator):
    """Key the hand with what the other rig does in a range of frames."""

    bl_idname = "livehand.bake_rig"
    bl_label = "Bake Other Rig"

    use_scene_range: BoolProperty(name="Scene Range", description="The scene's first to last frame", default=True)
    first: IntProperty(name="First", description="First frame", default=1)
    last: IntProperty(name="Last", description="Last frame", default=250)

    def invoke(self, context, event):
        """Ask for the frames."""
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        """Bake, and follow no longer."""
        armature, scene = polled_hand(context), context.scene
        rig = armature.livehand.other_rig
        first, last = (scene.frame_start, scene.frame_end) if self.use_scene_range else (self.first, self.last)
        try:
            model, _ = model_of(armature)
            if is_following(armature):
                check_editable(context, armature)  # before anything is keyed
            frames = range(first, last + 1)
            count = bake(context, armature, model, rig.armature, _joint_map(armature), frames, rig.fits_shape)
            if is_following(armature):
                stop_following(context, armature, keeps_pose=False)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Keyed {count} frames")
        return {"FINISHED"}


class LIVEHAND_OT_stop_following(OnHand, bpy.types.Operator):
    """Remove what makes the hand follow another rig."""

    bl_idname = "livehand.stop_following"
    bl_label = "Stop Following"
    bl_options = {"REGISTER", "UNDO"}

    keep_pose: BoolProperty(name="Keep Pose", description="Leave the hand as it is seen now", default=True)

    @classmethod
    def poll(cls, context):
        """Only on a hand that follows."""
        if not super().poll(context):
            return False
        if not is_following(polled_hand(context)):
            cls.poll_message_set("the hand follows no other rig")
            return False
        return True

    def execute(self, context):
        """Remove the constraints."""
        try:
            stop_following(context, polled_hand(context), self.keep_pose)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LIVEHAND_PT_other_rig(HandTab, bpy.types.Panel):
    """The rig that drives the active hand."""

    bl_label = "Other Rig"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Which rig, and what to do with it."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        armature = polled_hand(context)
        rig = armature.livehand.other_rig
        for name in ("armature", "side", "fits_shape"):
            layout.prop(rig, name)
        layout.operator("livehand.guess_bones", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.operator("livehand.follow_rig", icon="CON_ARMATURE")
        row.operator("livehand.bake_rig", text="Bake", icon="KEY_HLT")
        if is_following(armature):
            layout.prop(armature.livehand, "follow", text="Influence", slider=True)
            layout.operator("livehand.stop_following", icon="X")


class LIVEHAND_PT_other_rig_bones(HandTab, bpy.types.Panel):
    """Which bones are the joints."""

    bl_label = "Bones"
    bl_parent_id = "LIVEHAND_PT_other_rig"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Only where an armature is chosen."""
        armature = active_hand(context)
        return armature is not None and _has_rig(armature)

    def draw(self, context):
        """A field for every joint and every fingertip."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        rig = polled_hand(context).livehand.other_rig
        _draw_bones(self.layout, rig, ["wrist"])
        for finger in SHOWN_FINGERS:
            _draw_bones(self.layout, rig, [*(f"{finger}{k}" for k in (1, 2, 3)), tip_property(finger)])


CLASSES = (
    LIVEHAND_OT_guess_bones,
    LIVEHAND_OT_follow_rig,
    LIVEHAND_OT_bake_rig,
    LIVEHAND_OT_stop_following,
    LIVEHAND_PT_other_rig,
    LIVEHAND_PT_other_rig_bones,
)


def _draw_bones(layout: bpy.types.UILayout, rig: bpy.types.PropertyGroup, names: list[str]) -> None:
    column = layout.column(align=True)
    for name in names:
        column.prop_search(rig, name, rig.armature.data, "bones")


def _side(hand: bpy.types.PropertyGroup):
    return hand.side if hand.other_rig.side == "OWN" else hand.other_rig.side


def _joint_map(armature: bpy.types.Object) -> JointMap:
    """The fields, as they are filled in.

    Raises:
        LiveHandError: a joint has no bone, or two have the same.
    """
    rig = armature.livehand.other_rig
    tips = tuple(getattr(rig, tip_property(finger)) or None for finger in MANO_FINGERS)
    return JointMap(_side(armature.livehand), tuple(getattr(rig, joint) for joint in JOINT_NAMES), tips)
