"""The panel *Retarget*: a hand driven by another armature, live or baked."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty

from ...backend.hand.bones import FINGERS as SHOWN_FINGERS
from ...backend.hand.model import JOINT_NAMES, MANO_FINGERS
from ...backend.records.errors import LiveHandError
from ...backend.rigs.doubts import rest_doubts
from ...backend.rigs.joint_guess import JointGuess, guess_joints
from ...backend.rigs.rest_alignment import align
from ...backend.rigs.source_skeleton import JointMap, SourceSkeleton
from ..motion.taking import sample_take
from ..rig.follow_properties import tip_property
from ..rig.hand import RiggedHand, active_hand
from ..rig.sliders import slider_path
from ..rigs.aimed_bones import with_twists
from ..rigs.bake import bake
from ..rigs.follow import check_editable, follow, is_following, stop_following
from ..rigs.sending import send
from ..rigs.source import SourceRig, read_skeleton
from .mixins import FrameRange, HandTab, OnHand, polled_hand, reports_errors

_ARMS = (
    ("FK", "FK", "Turn the arm's bones, or a generated rig's FK controls"),
    ("IK", "IK", "Move the IK control of a generated rig"),
)


def _has_rig(armature: bpy.types.Object) -> bool:
    """Return whether an armature is chosen; scripts, and the field in Blender 4.2, may choose any object."""
    source = armature.livehand.other_rig.armature
    return source is not None and source.type == "ARMATURE"


class _OnRig(OnHand):
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Enable it on a hand for which an armature is chosen."""
        if not super().poll(context):
            return False
        if not _has_rig(polled_hand(context)):
            cls.poll_message_set("Choose the other rig's armature first")
            return False
        return True


class LIVEHAND_OT_guess_bones(_OnRig, bpy.types.Operator):
    """Find the hand's bones in the other rig by their names, or otherwise by their shape."""

    bl_idname = "livehand.guess_bones"
    bl_label = "Detect Bones"

    def execute(self, context):
        """Fill in the fields."""
        properties = polled_hand(context).livehand
        rig = properties.other_rig
        skeleton = read_skeleton(rig.armature)
        guess = guess_joints(skeleton, _side(properties))
        for joint, bone in zip(JOINT_NAMES, guess.bones, strict=True):
            setattr(rig, joint, bone or "")
        for finger, bone in zip(MANO_FINGERS, guess.tips, strict=True):
            setattr(rig, tip_property(finger), bone or "")
        rig.forearm = guess.forearm or ""
        if doubt := _doubt(skeleton, guess, polled_hand(context)):
            self.report({"WARNING"}, f"Check the bones of the {guess.side} hand: {doubt}")
        else:
            self.report({"INFO"}, f"Found the {guess.side} hand of {rig.armature.name}")
        return {"FINISHED"}


class LIVEHAND_OT_follow_rig(_OnRig, bpy.types.Operator):
    """Make the hand follow the other rig live, by constraints on hidden bones."""

    bl_idname = "livehand.follow_rig"
    bl_label = "Follow"

    @reports_errors
    def execute(self, context):
        """Add the constraints."""
        hand = RiggedHand.active(context)
        doubt = follow(context, hand, _source(hand), hand.properties.other_rig.fits_shape)
        if doubt:
            self.report({"WARNING"}, f"Check the hand: {doubt}")


class LIVEHAND_OT_bake_rig(_OnRig, FrameRange, bpy.types.Operator):
    """Key the hand with the other rig's motion in a range of frames."""

    bl_idname = "livehand.bake_rig"
    bl_label = "Bake Retargeted Motion"

    def invoke(self, context, event):
        """Ask for the frames."""
        return context.window_manager.invoke_props_dialog(self)

    @reports_errors
    def execute(self, context):
        """Bake, then stop following."""
        hand = RiggedHand.active(context)
        frames = self.frames(context.scene)
        if is_following(hand.armature):
            check_editable(context, hand)  # before anything is keyed
        keyed = bake(context, hand, _source(hand), frames, hand.properties.other_rig.fits_shape)
        if is_following(hand.armature):
            stop_following(context, hand, keeps_pose=False)
        if keyed.doubt:
            self.report({"WARNING"}, f"Check the motion: {keyed.doubt}")
        self.report({"INFO"}, f"Keyed {keyed.frames} frames")


class LIVEHAND_OT_send_to_rig(_OnRig, FrameRange, bpy.types.Operator):
    """Key the other rig's own bones with the hand's motion in a range of frames."""

    bl_idname = "livehand.send_to_rig"
    bl_label = "Send to Rig"

    arm: EnumProperty(name="Arm", description="The controls that move the wrist", items=_ARMS)

    def invoke(self, context, event):
        """Ask for the frames and the arm."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw the frames and the arm."""
        FrameRange.draw(self, context)
        self.layout.prop(self, "arm")

    @reports_errors
    def execute(self, context):
        """Sample the hand, then key the rig."""
        hand = RiggedHand.active(context)
        frames = self.frames(context.scene)
        taken = sample_take(context, [hand], frames).hands[0]
        sent = send(context, taken, _source(hand), frames, hand.properties.other_rig.fits_shape, self.arm)
        if sent.doubt:
            self.report({"WARNING"}, f"Check the rig: {sent.doubt}")
        self.report({"INFO"}, f"Keyed {sent.bones} bones in {sent.frames} frames")


class LIVEHAND_OT_stop_following(OnHand, bpy.types.Operator):
    """Remove the constraints that make the hand follow another rig."""

    bl_idname = "livehand.stop_following"
    bl_label = "Stop Following"
    bl_options = {"REGISTER", "UNDO"}

    keep_pose: BoolProperty(name="Keep Pose", description="Keep the hand's present pose", default=True)

    @classmethod
    def poll(cls, context):
        """Enable it on a hand that follows a rig."""
        if not super().poll(context):
            return False
        if not is_following(polled_hand(context)):
            cls.poll_message_set("The hand follows no other rig")
            return False
        return True

    @reports_errors
    def execute(self, context):
        """Remove the constraints."""
        stop_following(context, RiggedHand.active(context), self.keep_pose)


class LIVEHAND_PT_other_rig(HandTab, bpy.types.Panel):
    """The rig that drives the active hand."""

    bl_label = "Retarget"

    def draw(self, context):
        """Draw the choice of the rig, and the operators."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        armature = polled_hand(context)
        for name in ("armature", "side", "fits_shape"):
            layout.prop(armature.livehand.other_rig, name)
        layout.operator("livehand.guess_bones", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.operator("livehand.follow_rig", icon="CON_ARMATURE")
        row.operator("livehand.bake_rig", text="Bake", icon="KEY_HLT")
        layout.operator("livehand.send_to_rig", icon="EXPORT")
        if is_following(armature):
            layout.prop(armature, slider_path("follow"), text="Influence", slider=True)
            layout.operator("livehand.stop_following", icon="X")


class LIVEHAND_PT_other_rig_bones(HandTab, bpy.types.Panel):
    """Which of the other rig's bones are the hand's joints."""

    bl_label = "Bones"
    bl_parent_id = "LIVEHAND_PT_other_rig"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Show it if an armature is chosen."""
        armature = active_hand(context)
        return armature is not None and _has_rig(armature)

    def draw(self, context):
        """Draw a field for every joint and every fingertip."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        rig = polled_hand(context).livehand.other_rig
        groups = [
            ["forearm", "wrist"],
            *([*(f"{name}{k}" for k in (1, 2, 3)), tip_property(name)] for name in SHOWN_FINGERS),
        ]
        for names in groups:
            column = self.layout.column(align=True)
            for name in names:
                column.prop_search(rig, name, rig.armature.data, "bones")


CLASSES = (
    LIVEHAND_OT_guess_bones,
    LIVEHAND_OT_follow_rig,
    LIVEHAND_OT_bake_rig,
    LIVEHAND_OT_send_to_rig,
    LIVEHAND_OT_stop_following,
    LIVEHAND_PT_other_rig,
    LIVEHAND_PT_other_rig_bones,
)


def _side(properties: bpy.types.PropertyGroup):
    return properties.side if properties.other_rig.side == "OWN" else properties.other_rig.side


def _doubt(skeleton: SourceSkeleton, guess: JointGuess, armature: bpy.types.Object) -> str | None:
    """Report what speaks against the guessed bones; None: nothing."""
    try:
        alignment = align(skeleton, guess.joint_map(), RiggedHand.of(armature).model)
    except LiveHandError as error:
        return str(error)
    return rest_doubts(alignment)


def _source(hand: RiggedHand) -> SourceRig:
    """Read the rig that is chosen in the panel.

    Raises:
        LiveHandError: a joint has no bone, or two have the same one.
    """
    rig = hand.properties.other_rig
    bones = tuple(getattr(rig, joint) or None for joint in JOINT_NAMES)
    tips = tuple(getattr(rig, tip_property(finger)) or None for finger in MANO_FINGERS)
    joint_map = JointMap(_side(hand.properties), bones, tips, rig.forearm or None)
    return SourceRig(rig.armature, with_twists(rig.armature, joint_map))
