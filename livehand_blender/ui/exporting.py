"""Operators that give a hand's motion to other programs, and to a character's own bones."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ...backend.motion.mano_basis import find_basis
from ...backend.motion.writers.registry import choose_writer
from ...backend.motion.writers.writer import WriteOptions
from ..motion.taking import sample_take
from ..rig.hand import RiggedHand, find_hands
from ..rigs.blender_writers import ALL_WRITERS
from ..rigs.sending import send
from .mixins import FrameRange, OnHand, reports_errors
from .rigs import OnRig, chosen_rig

_HANDS = (
    ("ACTIVE", "Active", "The active hand"),
    ("ALL", "All", "The scene's hands, one of each side; own format and MANO hold one"),
)
_ARMS = (
    ("FK", "FK", "Turn the arm's bones, or a generated rig's FK controls"),
    ("IK", "IK", "Move the IK control of a generated rig"),
)
_FORMATS = tuple(
    (writer.name, writer.title, f"Files that end in {', '.join(writer.suffixes)}") for writer in ALL_WRITERS
)


class LIVEHAND_OT_export_take(OnHand, FrameRange, bpy.types.Operator, ExportHelper):
    """Write the motion of hands in a range of frames for other programs."""

    bl_idname = "livehand.export_take"
    bl_label = "Export LiveHand Motion"
    bl_options = {"REGISTER"}

    format: EnumProperty(name="Format", description="Format of the file", items=_FORMATS)
    hands: EnumProperty(name="Hands", description="Which hands are written", items=_HANDS)
    from_mean: BoolProperty(name="From Mean", description="Finger angles count from MANO's mean pose", default=False)
    mano_path: StringProperty(name="MANO File", description="Your MANO_RIGHT.pkl or MANO_LEFT.pkl", subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.npz;*.json;*.csv;*.bvh;*.fbx;*.glb;*.usd*", options={"HIDDEN"})

    @property
    def filename_ext(self) -> str:
        """Return the suffix of the chosen format."""
        return next(writer.suffixes[0] for writer in ALL_WRITERS if writer.name == self.format)

    def draw(self, context):
        """Draw the format, its options, and the frames."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "format")
        layout.prop(self, "hands")
        if self.format == "mano":
            layout.prop(self, "from_mean")
            column = layout.column()
            column.active = self.from_mean
            column.prop(self, "mano_path")
        FrameRange.draw(self, context)

    @reports_errors
    def execute(self, context):
        """Sample the frames, then write the file."""
        path = Path(bpy.path.abspath(self.filepath))
        writer = choose_writer(path, self.format, ALL_WRITERS)
        active = RiggedHand.active(context)
        hands = [RiggedHand.of(thing) for thing in find_hands(context.scene)] if self.hands == "ALL" else [active]
        mano_path = Path(bpy.path.abspath(self.mano_path)) if self.mano_path else None
        basis = find_basis(mano_path, active.model_path) if self.from_mean else None
        take = sample_take(context, hands, self.frames(context.scene))
        losses = writer.write(take, path, WriteOptions(self.from_mean and writer.name == "mano", basis))
        if losses:
            self.report({"WARNING"}, f"{writer.title}: {'; '.join(losses)}")
        self.report({"INFO"}, f"Wrote {take.count} frames as {writer.title}")


class LIVEHAND_OT_send_to_rig(OnRig, FrameRange, bpy.types.Operator):
    """Key the other rig's own bones with the hand's motion in a range of frames."""

    bl_idname = "livehand.send_to_rig"
    bl_label = "Send to Rig"

    arm: EnumProperty(name="Arm", description="The controls that move the wrist", items=_ARMS)

    def invoke(self, context, event):
        """Ask for the frames and the arm."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw the frames and the arm."""
        FrameRange.draw(self, context)
        self.layout.prop(self, "arm")

    @reports_errors
    def execute(self, context):
        """Sample the hand, then key the rig."""
        hand = RiggedHand.active(context)
        frames = self.frames(context.scene)
        taken = sample_take(context, [hand], frames).hands[0]
        sent = send(context, taken, chosen_rig(hand), frames, hand.properties.other_rig.fits_shape, self.arm)
        if sent.doubt:
            self.report({"WARNING"}, f"Check the rig: {sent.doubt}")
        self.report({"INFO"}, f"Keyed {sent.bones} bones in {sent.frames} frames")


CLASSES = (LIVEHAND_OT_export_take, LIVEHAND_OT_send_to_rig)
