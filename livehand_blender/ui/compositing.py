"""Compositor set-ups: two operators, and the LiveHand tab in the compositor's sidebar."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.records.errors import LiveHandError
from ..compositing.hand_over_plate import Plate, hand_over_plate
from ..compositing.hand_over_scene import hand_over_scene
from ..compositing.image_files import ImageFiles
from .mixins import reports_errors


def _other_scenes(operator, context, edit_text) -> list[str]:
    return [scene.name for scene in bpy.data.scenes if scene != context.scene]


class _SetUp:
    report: Callable[[set[str], str], None]
    bl_options = {"REGISTER", "UNDO"}

    replace_output: BoolProperty(
        name="Replace Output",
        description="Connect the nodes to the compositor's output even if other nodes than a plain render's are "
        "connected to it",
    )

    def report_output(self, is_output: bool) -> None:
        """Tell the user if the compositor's output shows something else."""
        if not is_output:
            self.report(
                {"WARNING"},
                "The nodes were added but are not shown: the compositor's output is connected to others. Connect them "
                "by hand, or choose Replace Output",
            )


class LIVEHAND_OT_setup_compositing(_SetUp, bpy.types.Operator):
    """Add compositor nodes that combine the rendered hand with another scene's render, by depth."""

    bl_idname = "livehand.setup_compositing"
    bl_label = "Set Up Hand over Scene"

    behind: StringProperty(
        name="Scene Behind",
        description="Scene with the same camera, rendered by another engine; empty: the hand alone",
        search=_other_scenes,
    )

    def invoke(self, context, event):
        """Ask for the scene and the output; where there is one other scene, it is proposed."""
        others = _other_scenes(self, context, "")
        if len(others) == 1 and not self.properties.is_property_set("behind"):
            self.behind = others[0]
        return context.window_manager.invoke_props_dialog(self)

    @reports_errors
    def execute(self, context):
        """Build the nodes."""
        self.report_output(hand_over_scene(context.scene, _scene(self.behind), self.replace_output))


class LIVEHAND_OT_load_sequence_over_plate(_SetUp, bpy.types.Operator, ImportHelper):
    """Add compositor nodes that put rendered frames of a hand over a plate."""

    bl_idname = "livehand.load_sequence_over_plate"
    bl_label = "Load Hand over Plate"

    filter_glob: StringProperty(default="*.exr;*.png", options={"HIDDEN"})
    plate_path: StringProperty(
        name="Plate",
        description="An image, a frame of an image sequence, or a movie; empty: the scene's active clip",
        subtype="FILE_PATH",
    )
    plate_is_still: BoolProperty(
        name="Still", description="The plate is this image only, even if it is one of a numbered sequence"
    )
    plate_delay: IntProperty(
        name="Plate Delay",
        description="Number of frames by which the plate is shifted later; a movie starts at frame 1",
    )

    @reports_errors
    def execute(self, context):
        """Build the nodes."""
        plate = Plate(_plate_source(self, context.scene), self.plate_delay)
        hand = ImageFiles.find(Path(bpy.path.abspath(self.filepath)))
        self.report_output(hand_over_plate(context.scene, hand, plate, self.replace_output))


class LIVEHAND_PT_compositing(bpy.types.Panel):
    """LiveHand's compositor set-ups."""

    bl_label = "LiveHand"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "LiveHand"

    @classmethod
    def poll(cls, context):
        """Show it while compositor nodes are edited."""
        return context.space_data.tree_type == "CompositorNodeTree"

    def draw(self, context):
        """Draw one button for each set-up."""
        column = self.layout.column()
        column.operator("livehand.setup_compositing", icon="RENDERLAYERS")
        column.operator("livehand.load_sequence_over_plate", icon="RENDER_RESULT")


CLASSES = (LIVEHAND_OT_setup_compositing, LIVEHAND_OT_load_sequence_over_plate, LIVEHAND_PT_compositing)


def _scene(name: str) -> bpy.types.Scene | None:
    """Find the scene of a name, or None for an empty name.

    Raises:
        LiveHandError: there is none.
    """
    if name and name not in bpy.data.scenes:
        raise LiveHandError(f"no scene '{name}' in this file; choose one of {', '.join(bpy.data.scenes.keys())}")
    return bpy.data.scenes[name] if name else None


def _plate_source(
    operator: LIVEHAND_OT_load_sequence_over_plate, scene: bpy.types.Scene
) -> ImageFiles | bpy.types.MovieClip:
    """Return the operator's file, or the scene's clip if no file is set.

    Raises:
        LiveHandError: there is neither, or the file does not exist.
    """
    if operator.plate_path:
        return ImageFiles.find(Path(bpy.path.abspath(operator.plate_path)), operator.plate_is_still)
    if scene.active_clip is None:
        raise LiveHandError("a plate is needed; choose an image or a movie, or load a clip into the scene")
    return scene.active_clip
