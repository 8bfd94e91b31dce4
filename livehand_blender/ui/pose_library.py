"""The pose library that ships with LiveHand, and the operator that adds it to the user's asset libraries."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import bpy

LIBRARY_NAME = "LiveHand"


def library_folder() -> Path:
    """The folder of the pose assets and their catalogs."""
    return Path(str(resources.files(str(__package__)))).parent / "assets"


def is_library_added(context: bpy.types.Context) -> bool:
    """Whether the user's preferences contain the folder."""
    libraries = context.preferences.filepaths.asset_libraries
    return any(Path(library.path) == library_folder() for library in libraries)


class LIVEHAND_OT_add_pose_library(bpy.types.Operator):
    """Add LiveHand's hand poses to your asset libraries (to remove them: Preferences, File Paths)."""

    bl_idname = "livehand.add_pose_library"
    bl_label = "Add Pose Library"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Disabled once the library is added."""
        if is_library_added(context):
            cls.poll_message_set("the library is already among your asset libraries")
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


CLASSES = (LIVEHAND_OT_add_pose_library,)
