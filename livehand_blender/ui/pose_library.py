"""The pose library that comes with LiveHand: added to the user's asset libraries when they ask for it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import bpy

LIBRARY_NAME = "LiveHand"


def library_folder() -> Path:
    """Where the pose assets and their catalogs lie."""
    return Path(str(resources.files(str(__package__)))).parent / "assets"


def is_library_added(context: bpy.types.Context) -> bool:
    """Whether the user's preferences name the folder."""
    libraries = context.preferences.filepaths.asset_libraries
    return any(Path(library.path) == library_folder() for library in libraries)


class LIVEHAND_OT_add_pose_library(bpy.types.Operator):
    """Add LiveHand's hand poses to your asset libraries; remove them in Preferences, File Paths."""

    bl_idname = "livehand.add_pose_library"
    bl_label = "Add Pose Library"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Only once."""
        if is_library_added(context):
            cls.poll_message_set("the library is among your asset libraries already")
            return False
        return True

    def execute(self, context):
        """Name the folder in the preferences, and open the shelf, which Blender hides at first."""
        context.preferences.filepaths.asset_libraries.new(name=LIBRARY_NAME, directory=str(library_folder()))
        context.preferences.is_dirty = True
        if isinstance(context.space_data, bpy.types.SpaceView3D):
            context.space_data.show_region_asset_shelf = True
        self.report({"INFO"}, f"Added as {LIBRARY_NAME}: in pose mode, see View > Asset Shelf")
        return {"FINISHED"}


CLASSES = (LIVEHAND_OT_add_pose_library,)
