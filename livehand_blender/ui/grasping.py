"""Operators of *Grasp*: in the current frame, or keyed in each frame of a range."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ...backend.hand.bones import FINGERS
from ...backend.records.errors import LiveHandError
from ...backend.system.thread_job import ThreadJob
from ..rig.hand import RiggedHand, find_hands, hand_of_mesh
from ..rig.keyframes import key_hand
from .jobs import RunsJob
from .mixins import FrameRange, OnHand, reports_errors
from .posing import FINGER_LABELS

if TYPE_CHECKING:  # contact needs packages that may be missing until an operator runs
    from ...backend.contact.grasp import Grasp, GraspOptions

_FINGER_ITEMS = tuple(
    (finger, FINGER_LABELS[finger], f"The {FINGER_LABELS[finger].lower()} finger may move") for finger in FINGERS
)


class _Grasps(OnHand):
    """Mixin of operators that close the active hand on the other selected objects."""

    layout: bpy.types.UILayout
    report: Callable[[set[str], str], None]

    fingers: EnumProperty(name="Fingers", items=_FINGER_ITEMS, options={"ENUM_FLAG"}, default=set(FINGERS))
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


CLASSES = (LIVEHAND_OT_grasp, LIVEHAND_OT_grasp_frames)
