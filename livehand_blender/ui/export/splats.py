"""Export of hands as Gaussian splats."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ....backend.render.splats.lit_hand import LitHand, SplatOptions
from ....backend.system.thread_job import ThreadJob
from ...render.frame_setup import lit_frames
from ..jobs import RunsJob
from ..mixins import FrameRange, OnHand, polled_hand

_FORMATS = (
    (".ply", "PLY", "As viewers and editors of splats read it; Y down"),
    (".glb", "glTF", "With KHR_gaussian_splatting; Y up"),
)
_HANDS = (("ACTIVE", "Active", "The active hand"), ("ALL", "All", "All visible hands, in one file"))


class LIVEHAND_OT_export_splats(OnHand, RunsJob, FrameRange, bpy.types.Operator, ExportHelper):
    """Write hands in the scene's light as Gaussian splats, fitted to pictures from all around: minutes a hand."""

    bl_idname = "livehand.export_splats"
    bl_label = "Export LiveHand Splats"
    bl_options = {"REGISTER"}

    format: EnumProperty(name="Format", description="Format of the file", items=_FORMATS)
    hands: EnumProperty(name="Hands", description="Which hands are written", items=_HANDS)
    count: IntProperty(
        name="Splats", description="About how many splats a hand gets", default=50_000, min=1000, max=500_000
    )
    views: IntProperty(name="Views", description="Pictures that they are fitted to", default=48, min=12, max=400)
    size_px: IntProperty(
        name="View Size",
        description="Width and height of such a picture",
        default=512,
        min=128,
        max=2048,
        subtype="PIXEL",
    )
    is_animated: BoolProperty(
        name="Animation", description="A numbered file for each frame; off: the current frame", default=False
    )
    filter_glob: StringProperty(default="*.ply;*.glb", options={"HIDDEN"})

    @property
    def filename_ext(self) -> str:
        """Return the suffix of the chosen format."""
        return self.format

    def draw(self, context):
        """Draw the format, the number of splats and views, and the frames."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("format", "hands", "count", "views", "size_px", "is_animated"):
            layout.prop(self, name)
        if self.is_animated:
            FrameRange.draw(self, context)

    def start(self, context: bpy.types.Context) -> ThreadJob:
        """Read the frames first, so that an error writes nothing; then fit and write them beside Blender."""
        scene, active = context.scene, polled_hand(context)
        options = SplatOptions(self.count, self.views, self.size_px)
        numbers = self.frames(scene) if self.is_animated else [scene.frame_current]

        def is_chosen(hand: LitHand) -> bool:
            return self.hands == "ALL" or hand.name == active.name_full

        frames = lit_frames(context, numbers, is_chosen)
        path = Path(bpy.path.abspath(self.filepath))
        from ....backend.render.splats.sequence import write_sequence  # torch, which may be missing until here

        return ThreadJob(
            "splats", lambda report, should_stop: write_sequence(frames, path, options, report, should_stop)
        )

    def take(self, context: bpy.types.Context, job: ThreadJob) -> None:
        """Say how well the splats fit."""
        self.report({"INFO"}, job.result().summary)


CLASSES = (LIVEHAND_OT_export_splats,)
