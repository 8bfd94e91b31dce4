"""Operators for posing: select fingers, snap poses between bones and fingertip targets, grasp, key the whole pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...backend.hand.bones import FINGERS, bone_name, finger_joints, target_name
from ...backend.records.errors import LiveHandError
from ...backend.system.thread_job import ThreadJob
from ..rig.fingertips import has_fingertip_targets, move_bones_to_ik, move_targets_to_fingertips
from ..rig.hand import RiggedHand, active_hand, find_hands, hand_of_mesh
from ..rig.keyframes import hand_channels, key_finger, key_hand
from ..rig.pose import apply_sliders, mirror_pose
from ..rig.selection import select_bones, selected_bones
from ..rig.sliders import read_slider
from .jobs import RunsJob
from .mixins import FrameRange, OnHand, polled_hand, reports_errors

if TYPE_CHECKING:  # contact needs packages that may be missing until an operator runs
    from ...backend.contact.grasp import Grasp, GraspOptions

FINGER_LABELS = {"thumb": "Thumb", "index": "Index", "middle": "Middle", "ring": "Ring", "pinky": "Little"}
_FINGER_ITEMS = tuple(
    (finger, FINGER_LABELS[finger], f"The {FINGER_LABELS[finger].lower()} finger") for finger in FINGERS
)
_MAY_MOVE_ITEMS = tuple((finger, label, f"The {label.lower()} finger may move") for finger, label, _ in _FINGER_ITEMS)
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


class _Grasps(OnHand):
    """Mixin of operators that close the active hand on the other selected objects."""

    layout: bpy.types.UILayout
    report: Callable[[set[str], str], None]

    fingers: EnumProperty(name="Fingers", items=_MAY_MOVE_ITEMS, options={"ENUM_FLAG"}, default=set(FINGERS))
    press: FloatProperty(
        name="Press",
        description="How deep pads press before they flatten",
        subtype="DISTANCE_CAMERA",
        default=0.6,
        min=0.0,
        max=1.0,
    )
    reach: FloatProperty(
        name="Reach",
        description="How far fingers that do not touch when they bend are drawn to the surface; 0 keeps their pose",
        subtype="DISTANCE_CAMERA",
        default=15.0,
        min=0.0,
        soft_max=60.0,
    )
    flatten: BoolProperty(name="Flatten Pads", description="Flatten the skin where it presses", default=True)

    def _draw(self, *names: str) -> None:
        self.layout.use_property_split = True
        self.layout.column().prop(self, "fingers")
        for name in ("press", "reach", "flatten", *names):
            self.layout.prop(self, name)

    def _options(self, moves_wrist: bool = False) -> GraspOptions:
        from ...backend.contact.grasp import GraspOptions

        if not self.fingers:
            raise LiveHandError("Fingers must be one or more, none is chosen; Shift-click the fingers that may move")
        chosen = tuple(finger for finger in FINGERS if finger in self.fingers)
        return GraspOptions(chosen, self.press / 1000, self.reach / 1000, moves_wrist)

    def _tell(self, found: Sequence[Grasp], where: str = "") -> None:
        inside = sorted({finger for one in found for finger in one.inside}, key=FINGERS.index)
        if inside:
            names, deepest_mm = ", ".join(FINGER_LABELS[one] for one in inside), 1000 * max(g.deepest_m for g in found)
            self.report({"WARNING"}, f"Up to {deepest_mm:.1f} mm stay inside: {names}; move the hand, and grasp again")
            return
        touching = [finger for finger in FINGERS if any(finger in one.touches for one in found)]
        self.report({"INFO"}, f"Touching{where}: {', '.join(FINGER_LABELS[finger] for finger in touching)}")


class LIVEHAND_OT_grasp(_Grasps, bpy.types.Operator):
    """Close the active hand on the other selected objects until it touches; its pose is kept as far as that allows."""

    bl_idname = "livehand.grasp"
    bl_label = "Grasp"
    bl_options = {"REGISTER", "UNDO"}

    move_wrist: BoolProperty(
        name="Move Wrist", description="Move a hand whose palm is inside the object out of it", default=False
    )
    both_hands: BoolProperty(
        name="Both Hands", description="If the object is another hand, close that on this one too", default=True
    )

    def draw(self, context):
        """Draw the settings."""
        self._draw("move_wrist", "both_hands")

    @reports_errors
    def execute(self, context):
        """Grasp, and say what touches."""
        from ..contact.grasping import clasp_now, grasp_now
        from ..contact.targets import Targets, selected_targets

        hand, options = RiggedHand.active(context), self._options(self.move_wrist)
        objects = selected_targets(context, hand)
        other = hand_of_mesh(objects[0]) if len(objects) == 1 else None
        if other is not None and self.both_hands:
            moved = [hand, RiggedHand.of(other)]
            found = clasp_now(context, (moved[0], moved[1]), options, self.flatten)
        else:
            found, moved = [grasp_now(context, hand, Targets(objects), options, self.flatten)], [hand]
        if context.scene.tool_settings.use_keyframe_insert_auto:
            for one in moved:
                key_hand(one, context.scene.frame_current)
        self._tell(found)


class LIVEHAND_OT_grasp_frames(_Grasps, RunsJob, FrameRange, bpy.types.Operator):
    """Close the active hand on the other selected objects in each frame of a range, and key its fingers."""

    bl_idname = "livehand.grasp_frames"
    bl_label = "Grasp Frames"
    bl_options = {"UNDO"}  # to adjust it afterwards would be to grasp all frames again

    def invoke(self, context, event):
        """Ask for the settings and the frames."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw the settings and the frames."""
        self._draw()
        FrameRange.draw(self, context)

    def start(self, context: bpy.types.Context) -> ThreadJob:
        """Read hand and things in all frames first; then grasp beside Blender."""
        from ..contact.grasping import grasped_frames, read_frames
        from ..contact.targets import Targets, selected_targets

        hand, options, flattens = RiggedHand.active(context), self._options(), self.flatten
        frames = list(self.frames(context.scene))
        shot = read_frames(context, hand, Targets(selected_targets(context, hand)), frames)
        self._hand, self._frames, model = hand.armature.name_full, frames, hand.model
        return ThreadJob(
            "grasp", lambda report, should_stop: grasped_frames(model, shot, options, flattens, report, should_stop)
        )

    def take(self, context: bpy.types.Context, job: ThreadJob) -> None:
        """Key the fingers, and say what touches."""
        from ..contact.grasping import key_grasps

        found = job.result()
        armature = next((one for one in find_hands(context.scene) if one.name_full == self._hand), None)
        if armature is None:
            raise LiveHandError(f"{self._hand} must stay in the scene until it is keyed, it is gone; grasp again")
        key_grasps(RiggedHand.of(armature), found, self._frames)
        self._tell(found.grasps, f" in {sum(bool(one.touches) for one in found.grasps)} frames")


CLASSES = (
    LIVEHAND_OT_select_finger,
    LIVEHAND_OT_select_bone,
    LIVEHAND_OT_snap_ik_to_fk,
    LIVEHAND_OT_snap_fk_to_ik,
    LIVEHAND_OT_mirror_pose,
    LIVEHAND_OT_apply_sliders,
    LIVEHAND_OT_key_hand,
    LIVEHAND_OT_grasp,
    LIVEHAND_OT_grasp_frames,
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
