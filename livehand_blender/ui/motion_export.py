"""Export of a hand's motion."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from ...backend.motion.formats.own import write_motion
from ..motion.keying import sample_motion
from ..rig.hand import RiggedHand
from .mixins import FrameRange, OnHand, reports_errors


class LIVEHAND_OT_export_motion(OnHand, FrameRange, bpy.types.Operator, ExportHelper):
    """Write the active hand's motion in a range of frames to a .npz file."""

    bl_idname = "livehand.export_motion"
    bl_label = "Export Hand Motion"
    bl_options = {"REGISTER"}

    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    @reports_errors
    def execute(self, context):
        """Sample the frames, then write the file."""
        motion = sample_motion(context, RiggedHand.active(context), self.frames(context.scene))
        write_motion(motion, Path(bpy.path.abspath(self.filepath)))
        self.report({"INFO"}, f"Wrote {len(motion)} frames")


CLASSES = (LIVEHAND_OT_export_motion,)
