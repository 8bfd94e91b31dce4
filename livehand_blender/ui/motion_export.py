"""Export of a hand's motion."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ...backend.motion.formats.own import write_motion
from ...backend.records.errors import LiveHandError
from ..motion.keying import sample_motion
from .active_hand import OnHand, active_hand


class LIVEHAND_OT_export_motion(OnHand, bpy.types.Operator, ExportHelper):
    """Write what the active hand does in a range of frames to a .npz file."""

    bl_idname = "livehand.export_motion"
    bl_label = "Export Hand Motion"
    bl_options = {"REGISTER"}

    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})
    use_scene_range: BoolProperty(name="Scene Range", description="The scene's first to last frame", default=True)
    first: IntProperty(name="First", description="First frame", default=1)
    last: IntProperty(name="Last", description="Last frame", default=250)

    def draw(self, context):
        """Which frames."""
        self.layout.use_property_split = True
        self.layout.prop(self, "use_scene_range")
        column = self.layout.column(align=True)
        column.active = not self.use_scene_range
        column.prop(self, "first")
        column.prop(self, "last")

    def execute(self, context):
        """Sample the frames, then write."""
        scene = context.scene
        first, last = (scene.frame_start, scene.frame_end) if self.use_scene_range else (self.first, self.last)
        try:
            if last < first:
                raise LiveHandError(f"the last frame must not lie before the first, got {first} to {last}")
            motion = sample_motion(context, active_hand(context), range(first, last + 1))
            write_motion(motion, Path(bpy.path.abspath(self.filepath)))
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Wrote {len(motion)} frames")
        return {"FINISHED"}


CLASSES = (LIVEHAND_OT_export_motion,)
