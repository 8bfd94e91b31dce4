"""The picker: the hand's bones as buttons in the layout of a hand, and the sliders of its controls."""

from __future__ import annotations

import bpy

from ...backend.hand.bones import FINGERS, bone_name, finger_joints, forearm_name, target_name
from ..rig.armature import COLLECTIONS
from ..rig.sliders import FINGER_SLIDERS, SLIDERS, slider_path
from .mixins import OfHand, Tab, polled_hand
from .pose_library import is_library_added
from .posing import FINGER_LABELS, has_controls

# A fifth of a narrow tab has no room for a word; the tooltip has it.
_SHORT_LABELS = {finger: label[0] for finger, label in FINGER_LABELS.items()}
# Empty rows above each finger, by how much lower its tip is than the middle finger's.
_LOWER_ROWS = {"thumb": 2.2, "index": 0.4, "middle": 0.0, "ring": 0.3, "pinky": 1.2}


class LIVEHAND_PT_posing(OfHand, Tab, bpy.types.Panel):
    """Bones and controls of the active hand."""

    bl_label = "Pose"
    bl_order = 1

    def draw(self, context):
        """Draw the picker above, sliders below."""
        if not has_controls(context):
            self.layout.label(text="No Finger Controls", icon="INFO")
            self.layout.operator("livehand.add_hand", text="Add Hand", icon="VIEW_PAN")
            return
        armature = polled_hand(context)
        if not is_library_added(context):  # at the top, because it would be overlooked below the sliders
            self.layout.operator("livehand.add_pose_library", icon="ASSET_MANAGER")
        row = self.layout.row(align=True)
        row.operator("livehand.key_hand", icon="KEY_HLT")
        row.operator("livehand.mirror_pose", text="Mirror", icon="MOD_MIRROR")
        row = self.layout.row(align=True)
        row.operator("livehand.grasp", icon="VIEW_PAN")
        row.operator("livehand.grasp_frames", icon="RENDER_ANIMATION")
        _draw_collections(self.layout, armature)
        _draw_picker(self.layout, armature)
        _draw_controls(self.layout, armature)
        row = self.layout.row(align=True)
        row.operator("livehand.snap_ik_to_fk", text="FK > IK").finger = "all"
        row.operator("livehand.snap_fk_to_ik", text="IK > FK").finger = "all"
        self.layout.operator("livehand.apply_sliders")


CLASSES = (LIVEHAND_PT_posing,)


def _draw_collections(layout: bpy.types.UILayout, armature: bpy.types.Object) -> None:
    """Draw a switch for each of the rig's bone collections, two in a row: more names have no room beside each other."""
    column = layout.column(align=True)
    for names in (COLLECTIONS[:2], COLLECTIONS[2:]):
        row = column.row(align=True)
        for collection in filter(None, map(armature.data.collections.get, names)):
            row.prop(collection, "is_visible", text=collection.name, toggle=True)


def _draw_picker(layout: bpy.types.UILayout, armature: bpy.types.Object) -> None:
    """Draw the hand as seen from its back, fingers up: a right hand's thumb is on the left."""
    side = armature.livehand.side
    box = layout.box()
    row = box.row(align=True)
    for finger in FINGERS if side == "right" else reversed(FINGERS):
        column = row.column(align=True)
        column.separator(factor=4 * _LOWER_ROWS[finger])
        button = column.operator("livehand.select_bone", text="", icon="DECORATE_KEYFRAME")
        button.bone = target_name(finger, side)
        for joint in reversed(finger_joints(finger)):
            name = bone_name(joint, side)
            column.operator("livehand.select_bone", text=name[-3]).bone = name
        column.operator("livehand.select_finger", text=_SHORT_LABELS[finger]).finger = finger
    box.operator("livehand.select_bone", text="Wrist").bone = bone_name(0, side)
    if forearm_name(side) in armature.pose.bones:
        box.operator("livehand.select_bone", text="Forearm").bone = forearm_name(side)


def _draw_controls(layout: bpy.types.UILayout, armature: bpy.types.Object) -> None:
    column = layout.column(align=True)
    for name in ("fist", "opposition"):
        column.prop(armature, slider_path(name), text=SLIDERS[name].label, slider=True)
    column = layout.column(align=True)
    heads = column.row(align=True)
    for text in ("", "Curl", "Spread", "IK"):  # a tab of usual width has no room for labels beside the numbers
        heads.label(text=text)
    for finger in FINGERS:
        row = column.row(align=True)
        row.label(text=FINGER_LABELS[finger])
        for name in FINGER_SLIDERS:
            row.prop(armature, slider_path(f"{finger}.{name}"), text="", slider=True)
    layout.prop(armature, slider_path("limit_joints"), text=SLIDERS["limit_joints"].label)
