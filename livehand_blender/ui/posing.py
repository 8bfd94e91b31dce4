"""Operators for posing: select fingers, snap poses between bones and fingertip targets, key the whole pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...backend.hand.bones import FINGERS, bone_name, finger_joints, target_name
from ...backend.records.errors import LiveHandError
from ..rig.fingertips import has_fingertip_targets, move_bones_to_ik, move_targets_to_fingertips
from ..rig.hand import RiggedHand, active_hand
from ..rig.keyframes import hand_channels, key_finger, key_hand
from ..rig.pose import apply_sliders, mirror_pose
from ..rig.selection import select_bones, selected_bones
from ..rig.sliders import read_slider
from .mixins import polled_hand, reports_errors

FINGER_LABELS = {"thumb": "Thumb", "index": "Index", "middle": "Middle", "ring": "Ring", "pinky": "Little"}
_FINGER_ITEMS = tuple(
    (finger, FINGER_LABELS[finger], f"The {FINGER_LABELS[finger].lower()} finger") for finger in FINGERS
)
_WHICH_ITEMS = (("all", "All", "All five fingers"), *_FINGER_ITEMS)


def has_controls(context: bpy.types.Context) -> bool:
    """Return whether the active hand has finger controls, whose bones a user may have deleted."""
    armature = active_hand(context)
    return armature is not None and has_fingertip_targets(armature)


class _OnControls:
    poll_message_set: ClassVar[Callable[[str], None]]
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Enable it on a hand that has finger controls."""
        if not has_controls(context):
            cls.poll_message_set("Select a LiveHand hand with finger controls first")
            return False
        return True


class _Select(_OnControls):
    execute: Callable[[bpy.types.Context], set[str]]

    extend: BoolProperty(name="Extend", description="Extend the selection", options={"SKIP_SAVE"})

    def invoke(self, context, event):
        """Shift extends the selection."""
        self.extend = event.shift
        return self.execute(context)


class _Snap(_OnControls):
    finger: EnumProperty(name="Fingers", items=_WHICH_ITEMS, default="all")

    move: Callable[[bpy.types.Context, RiggedHand, Sequence[str]], None]

    @reports_errors
    def execute(self, context):
        """Move targets or bones, and key them if automatic keying is on."""
        hand = RiggedHand.active(context)
        fingers = FINGERS if self.finger == "all" else (self.finger,)
        self.move(context, hand, fingers)
        if context.scene.tool_settings.use_keyframe_insert_auto:
            for finger in fingers:
                key_finger(hand, finger, context.scene.frame_current)


class LIVEHAND_OT_select_finger(_Select, bpy.types.Operator):
    """Select a finger's bones, or its target if the finger uses IK; Shift extends the selection."""

    bl_idname = "livehand.select_finger"
    bl_label = "Select Finger"

    finger: EnumProperty(name="Finger", items=_FINGER_ITEMS)

    def execute(self, context):
        """Select in pose mode."""
        armature = polled_hand(context)
        side = armature.livehand.side
        if read_slider(armature, f"{self.finger}.ik") > 0.5:
            names = [target_name(self.finger, side)]
        else:
            names = [bone_name(joint, side) for joint in finger_joints(self.finger)]
        _select(context, names, self.extend)
        return {"FINISHED"}


class LIVEHAND_OT_select_bone(_Select, bpy.types.Operator):
    """Select a bone; Shift extends the selection."""

    bl_idname = "livehand.select_bone"
    bl_label = "Select Bone"

    bone: StringProperty(name="Bone")

    @reports_errors
    def execute(self, context):
        """Select in pose mode."""
        if self.bone not in polled_hand(context).pose.bones:
            raise LiveHandError(f"the hand has no bone {self.bone}")
        _select(context, [self.bone], self.extend)


class LIVEHAND_OT_snap_ik_to_fk(_Snap, bpy.types.Operator):
    """Move the fingertip targets to the fingertips, and switch to IK; the pose is unchanged."""

    bl_idname = "livehand.snap_ik_to_fk"
    bl_label = "Snap IK to FK"

    move = staticmethod(move_targets_to_fingertips)


class LIVEHAND_OT_snap_fk_to_ik(_Snap, bpy.types.Operator):
    """Rotate the bones to the IK pose, and switch to FK; the pose is unchanged."""

    bl_idname = "livehand.snap_fk_to_ik"
    bl_label = "Snap FK to IK"

    move = staticmethod(move_bones_to_ik)


class LIVEHAND_OT_mirror_pose(_OnControls, bpy.types.Operator):
    """Give the nearest hand of the other side the mirror image of this hand's pose."""

    bl_idname = "livehand.mirror_pose"
    bl_label = "Mirror to Other Hand"

    turn_wrist: BoolProperty(name="Wrist", description="Turn the wrist as well", default=True)

    @reports_errors
    def execute(self, context):
        """Pose the other hand, and key it if automatic keying is on."""
        hand = RiggedHand.active(context)
        other = _other_hand(context, hand)
        mirror_pose(hand, other, context.evaluated_depsgraph_get(), self.turn_wrist)
        if context.scene.tool_settings.use_keyframe_insert_auto:
            key_hand(other, context.scene.frame_current)
        self.report({"INFO"}, f"Posed {other.armature.name}")


class LIVEHAND_OT_apply_sliders(_OnControls, bpy.types.Operator):
    """Turn the bones as sliders and IK turn them, and set these to zero: Copy Pose copies bones alone."""

    bl_idname = "livehand.apply_sliders"
    bl_label = "Apply Sliders to Bones"

    @reports_errors
    def execute(self, context):
        """Pose the bones, and key them if automatic keying is on."""
        hand = RiggedHand.active(context)
        apply_sliders(hand, context.evaluated_depsgraph_get())
        if context.scene.tool_settings.use_keyframe_insert_auto:
            key_hand(hand, context.scene.frame_current)


def _other_hand(context: bpy.types.Context, hand: RiggedHand) -> RiggedHand:
    """Find the nearest hand of the other side that can be posed."""
    others = [one for one in RiggedHand.all_in(context.scene) if one.side != hand.side and one.armature.is_editable]
    if not others:
        side = "left" if hand.side == "right" else "right"
        raise LiveHandError(f"the scene must have a {side} hand, it has none; add one with Add Hand")
    place = hand.armature.matrix_world.translation
    return min(others, key=lambda one: (one.armature.matrix_world.translation - place).length)


class LIVEHAND_OT_key_hand(_OnControls, bpy.types.Operator):
    """Key the whole pose in the current frame: bones, fingertip targets and finger controls."""

    bl_idname = "livehand.key_hand"
    bl_label = "Key Hand"

    @reports_errors
    def execute(self, context):
        """Key the active hand."""
        key_hand(RiggedHand.active(context), context.scene.frame_current)


class LIVEHAND_KS_hand(bpy.types.KeyingSetInfo):
    """Key the whole pose of the active hand."""

    bl_idname = "LIVEHAND_KS_hand"
    bl_label = "LiveHand"
    bl_description = "Bones, fingertip targets and finger controls of the active LiveHand hand"

    def poll(self, context):
        """Enable it on a hand that has controls."""
        return has_controls(context)

    def iterator(self, context, keying_set):
        """Add only the active hand."""
        self.generate(context, keying_set, active_hand(context))

    def generate(self, context, keying_set, data):
        """Add one path per channel, grouped by bone and by finger."""
        for path, group in hand_channels(RiggedHand.of(data)):
            keying_set.paths.add(data, path, index=-1, group_method="NAMED", group_name=group)


CLASSES = (
    LIVEHAND_OT_select_finger,
    LIVEHAND_OT_select_bone,
    LIVEHAND_OT_snap_ik_to_fk,
    LIVEHAND_OT_snap_fk_to_ik,
    LIVEHAND_OT_mirror_pose,
    LIVEHAND_OT_apply_sliders,
    LIVEHAND_OT_key_hand,
    LIVEHAND_KS_hand,
)


def _select(context: bpy.types.Context, names: list[str], extend: bool) -> None:
    """Select bones of the active hand in pose mode; the last one becomes active."""
    armature = polled_hand(context)
    if context.active_object != armature and context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    context.view_layer.objects.active = armature
    armature.select_set(True)
    if armature.mode != "POSE":
        bpy.ops.object.mode_set(mode="POSE")
    select_bones(armature, {*names, *(selected_bones(armature) if extend else ())})
    armature.data.bones.active = armature.data.bones[names[-1]]
