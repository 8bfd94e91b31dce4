"""The pose library that ships with LiveHand, and the operator that adds it to the user's asset libraries."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import BoolProperty

from ...backend.hand.bones import FINGERS, bone_name
from ..rig.fingertips import has_fingertip_targets, move_bones_to_ik
from ..rig.hand import RiggedHand, active_hand
from ..rig.selection import select_bones, selected_bones
from ..rig.sliders import read_slider

LIBRARY_NAME = "LiveHand"


def library_folder() -> Path:
    """Return the folder of the pose assets and their catalogs."""
    return Path(str(resources.files(str(__package__)))).parent / "assets"


def is_library_added(context: bpy.types.Context) -> bool:
    """Return whether the user's preferences contain the folder."""
    libraries = context.preferences.filepaths.asset_libraries
    return any(Path(library.path) == library_folder() for library in libraries)


class LIVEHAND_OT_add_pose_library(bpy.types.Operator):
    """Add LiveHand's hand poses to your asset libraries (to remove them: Preferences, File Paths)."""

    bl_idname = "livehand.add_pose_library"
    bl_label = "Add Pose Library"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Disable it once the library is added."""
        if is_library_added(context):
            cls.poll_message_set("The library is already among your asset libraries")
            return False
        return True

    def execute(self, context):
        """Add the folder to the preferences, and open the asset shelf, which Blender hides by default."""
        context.preferences.filepaths.asset_libraries.new(name=LIBRARY_NAME, directory=str(library_folder()))
        context.preferences.is_dirty = True
        if isinstance(context.space_data, bpy.types.SpaceView3D):
            context.space_data.show_region_asset_shelf = True
        self.report({"INFO"}, f"Added as {LIBRARY_NAME}: in pose mode, see View > Asset Shelf")
        return {"FINISHED"}


class LIVEHAND_OT_use_pose(bpy.types.Operator):
    """Apply the pose to the whole hand, whatever bone is selected, with IK off; drag to blend it in."""

    bl_idname = "livehand.use_pose"
    bl_label = "Apply Pose to Hand"
    bl_options = {"INTERNAL"}

    blend: BoolProperty(name="Blend", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        """Enable it on an action under the mouse, for a hand in pose mode; otherwise Blender's own operator runs."""
        armature = active_hand(context)
        asset = getattr(context, "asset", None)
        is_pose = asset is not None and asset.id_type == "ACTION"
        return is_pose and armature == context.active_object and armature is not None and armature.mode == "POSE"

    def invoke(self, context, event):
        """Prepare the hand, and let Blender's pose library do the rest."""
        hand = RiggedHand.active(context)
        if self.blend:
            prepare_for_pose(context, hand, keeps_fingers=True)
            return bpy.ops.poselib.blend_pose_asset("INVOKE_DEFAULT")
        selected = prepare_for_pose(context, hand, keeps_fingers=False)
        result = bpy.ops.poselib.apply_pose_asset("EXEC_DEFAULT", True)
        select_bones(hand.armature, selected)
        return result


def prepare_for_pose(context: bpy.types.Context, hand: RiggedHand, keeps_fingers: bool) -> set[str]:
    """Turn IK off, which would hide a pose, and deselect all bones, so that Blender poses them all.

    Args:
        context: of the operator.
        hand: in pose mode.
        keeps_fingers: whether a selection stays if it holds finger bones, which are then posed alone.

    Returns:
        The names of the bones that were selected.
    """
    if has_fingertip_targets(hand.armature):
        fingers = [finger for finger in FINGERS if read_slider(hand.armature, f"{finger}.ik")]
        if fingers:
            move_bones_to_ik(context, hand, fingers)
    selected = selected_bones(hand.armature)
    if not keeps_fingers or selected.isdisjoint(bone_name(joint, hand.side) for joint in range(1, 16)):
        select_bones(hand.armature, set())
    return selected


class _Keys:
    """What the user's key maps have been given."""

    items: ClassVar[list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]]] = []


def add_keys() -> None:
    """Take the clicks and drags on poses before Blender's pose library does."""
    config = bpy.context.window_manager.keyconfigs.addon
    if config is None:  # without a window
        return
    shelf = config.keymaps.new(name="Asset Shelf")
    browser = config.keymaps.new(name="File Browser Main", space_type="FILE_BROWSER")
    for keys, event, blends in ((shelf, "CLICK", False), (shelf, "CLICK_DRAG", True), (browser, "DOUBLE_CLICK", False)):
        item = keys.keymap_items.new(LIVEHAND_OT_use_pose.bl_idname, "LEFTMOUSE", event, head=True)
        item.properties.blend = blends
        _Keys.items.append((keys, item))


def remove_keys() -> None:
    """Undo `add_keys`."""
    for keys, item in _Keys.items:
        keys.keymap_items.remove(item)
    _Keys.items.clear()


CLASSES = (LIVEHAND_OT_add_pose_library, LIVEHAND_OT_use_pose)
