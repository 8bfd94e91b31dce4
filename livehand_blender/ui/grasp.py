"""*Grasp*: closes the active hand on the other selected objects, or two hands on each other."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ...backend.hand.bones import FINGERS
from ...backend.records.errors import LiveHandError
from ..rig.hand import RiggedHand, hand_of_mesh
from ..rig.keyframes import key_hand
from .mixins import FrameRange, OnHand, reports_errors
from .posing import FINGER_LABELS

_FINGER_ITEMS = tuple(
    (finger, FINGER_LABELS[finger], f"The {FINGER_LABELS[finger].lower()} finger may move") for finger in FINGERS
)


class LIVEHAND_OT_grasp(OnHand, FrameRange, bpy.types.Operator):
    """Close the active hand on the other selected objects until it touches; its pose is kept as far as that allows."""

    bl_idname = "livehand.grasp"
    bl_label = "Grasp"
    bl_options = {"REGISTER", "UNDO"}

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
    move_wrist: BoolProperty(
        name="Move Wrist", description="Move a hand whose palm is inside the object out of it", default=False
    )
    flatten: BoolProperty(name="Flatten Pads", description="Flatten the skin where it presses", default=True)
    both_hands: BoolProperty(
        name="Both Hands", description="If the object is another hand, close that on this one too", default=True
    )
    use_range: BoolProperty(name="Key Frames", description="Grasp in each frame of a range, and key it", default=False)

    def draw(self, context):
        """Draw the settings, and the frames if they are keyed."""
        layout = self.layout
        layout.use_property_split = True
        layout.column().prop(self, "fingers")
        for name in ("press", "reach", "move_wrist", "flatten", "both_hands", "use_range"):
            layout.prop(self, name)
        if self.use_range:
            FrameRange.draw(self, context)

    @reports_errors
    def execute(self, context):
        """Grasp, and say what touches."""
        from ..contact.grasping import clasp_now, grasp_frames, grasp_now
        from ..contact.targets import Targets, selected_targets

        hand, options = RiggedHand.active(context), self._options()
        objects = selected_targets(context, hand)
        other = hand_of_mesh(objects[0]) if len(objects) == 1 else None
        if self.use_range:
            frames = list(self.frames(context.scene))
            found = grasp_frames(context, hand, Targets(objects), frames, options, self.flatten)
            moved = []
        elif other is not None and self.both_hands:
            moved = [hand, RiggedHand.of(other)]
            found = clasp_now(context, (moved[0], moved[1]), options, self.flatten)
        else:
            found, moved = [grasp_now(context, hand, Targets(objects), options, self.flatten)], [hand]
        if context.scene.tool_settings.use_keyframe_insert_auto:
            for one in moved:
                key_hand(one, context.scene.frame_current)
        self._report(found)

    def _options(self):
        from ...backend.contact.grasp import GraspOptions

        if not self.fingers:
            raise LiveHandError("Fingers must be one or more, none is chosen; Shift-click the fingers that may move")
        chosen = tuple(finger for finger in FINGERS if finger in self.fingers)
        return GraspOptions(chosen, self.press / 1000, self.reach / 1000, self.move_wrist)

    def _report(self, found) -> None:
        inside = sorted({finger for one in found for finger in one.inside}, key=FINGERS.index)
        if inside:
            names, deepest_mm = ", ".join(FINGER_LABELS[one] for one in inside), 1000 * max(g.deepest_m for g in found)
            self.report({"WARNING"}, f"Up to {deepest_mm:.1f} mm stay inside: {names}; move the hand, and grasp again")
            return
        touching = [finger for finger in FINGERS if any(finger in one.touches for one in found)]
        where = f" in {sum(bool(one.touches) for one in found)} frames" if self.use_range else ""
        self.report({"INFO"}, f"Touching{where}: {', '.join(FINGER_LABELS[finger] for finger in touching)}")


CLASSES = (LIVEHAND_OT_grasp,)
