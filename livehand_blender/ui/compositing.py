"""The compositor's set-up: two operators, and the LiveHand tab in the compositor's sidebar."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.records.errors import LiveHandError
from ..compositing.hand_over_plate import Plate, hand_over_plate
from ..compositing.hand_over_scene import hand_over_scene
from ..compositing.picture_files import PictureFiles

_REPLACE_OUTPUT = {
    "name": "Replace Output",
    "description": "Connect the nodes to the compositor's output even if something else is connected to it",
}


def _other_scenes(operator, context, edit_text) -> list[str]:
    return [scene.name for scene in bpy.data.scenes if scene != context.scene]


class LIVEHAND_OT_setup_compositing(bpy.types.Operator):
    """Add compositor nodes that lay the rendered hand over another scene's render, by depth."""

    bl_idname = "livehand.setup_compositing"
    bl_label = "Set Up Hand over Scene"
    bl_options = {"REGISTER", "UNDO"}

    behind: StringProperty(
        name="Scene Behind",
        description="Scene with the same camera, rendered by another engine; empty for the hand alone",
        search=_other_scenes,
    )
    replace_output: BoolProperty(**_REPLACE_OUTPUT)

    def execute(self, context):
        """Build the nodes."""
        try:
            is_output = hand_over_scene(context.scene, _scene(self.behind), self.replace_output)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        _report(self, is_output)
        return {"FINISHED"}


class LIVEHAND_OT_load_sequence_over_plate(bpy.types.Operator, ImportHelper):
    """Add compositor nodes that lay finished frames of a hand over a plate."""

    bl_idname = "livehand.load_sequence_over_plate"
    bl_label = "Load Hand over Plate"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.exr;*.png", options={"HIDDEN"})
    plate_path: StringProperty(
        name="Plate",
        description="A picture, a frame of an image sequence, or a movie; empty for the scene's active clip",
        subtype="FILE_PATH",
    )
    plate_is_still: BoolProperty(
        name="Still", description="The plate is this one picture, though others have the same name and another number"
    )
    plate_delay: IntProperty(
        name="Plate Delay",
        description="Frames by which the plate comes later than its numbers say; a movie begins at number 1",
    )
    replace_output: BoolProperty(**_REPLACE_OUTPUT)

    def execute(self, context):
        """Build the nodes."""
        try:
            plate = Plate(_plate_source(self, context.scene), self.plate_delay)
            hand = PictureFiles.find(Path(bpy.path.abspath(self.filepath)))
            is_output = hand_over_plate(context.scene, hand, plate, self.replace_output)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        _report(self, is_output)
        return {"FINISHED"}


class LIVEHAND_PT_compositing(bpy.types.Panel):
    """LiveHand's set-ups in the compositor."""

    bl_label = "LiveHand"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "LiveHand"

    @classmethod
    def poll(cls, context):
        """Only where compositor nodes are edited."""
        return context.space_data.tree_type == "CompositorNodeTree"

    def draw(self, context):
        """One button each."""
        column = self.layout.column()
        column.operator("livehand.setup_compositing", icon="RENDERLAYERS")
        column.operator("livehand.load_sequence_over_plate", icon="RENDER_RESULT")


CLASSES = (LIVEHAND_OT_setup_compositing, LIVEHAND_OT_load_sequence_over_plate, LIVEHAND_PT_compositing)


def _scene(name: str) -> bpy.types.Scene | None:
    """The scene of that name, None for an empty one.

    Raises:
        LiveHandError: there is none.
    """
    if name and name not in bpy.data.scenes:
        raise LiveHandError(f"no scene '{name}' in this file; choose one of {', '.join(bpy.data.scenes.keys())}")
    return bpy.data.scenes[name] if name else None


def _plate_source(
    operator: LIVEHAND_OT_load_sequence_over_plate, scene: bpy.types.Scene
) -> PictureFiles | bpy.types.MovieClip:
    """The operator's file, or else the scene's clip.

    Raises:
        LiveHandError: there is neither, or no such file.
    """
    if operator.plate_path:
        return PictureFiles.find(Path(bpy.path.abspath(operator.plate_path)), operator.plate_is_still)
    if scene.active_clip is None:
        raise LiveHandError("a plate is needed; choose a picture or a movie, or load a clip into the scene")
    return scene.active_clip


def _report(operator: bpy.types.Operator, is_output: bool) -> None:
    if not is_output:
        operator.report({"INFO"}, "The compositor's output was connected already; it is left as it was")
