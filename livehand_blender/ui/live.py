"""Hands that follow a camera: start, record, stop."""

from __future__ import annotations

import textwrap
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...backend.records.errors import LiveHandError
from ...backend.system.packages import CAMERA, missing_of, missing_requirements
from ...backend.tracking.live import CameraSource
from ...backend.tracking.weights import has_networks
from ..motion.live import LiveSession, LiveSetup
from .mixins import reports_errors
from .packages import draw_packages

_INTERVAL_S = 1 / 60
_LINE_CHARACTERS = 40  # of a warning in the sidebar


class LIVEHAND_OT_live(bpy.types.Operator):
    """Let the scene's hands follow those before a camera, without keys; Esc ends it."""

    bl_idname = "livehand.live"
    bl_label = "Live Hands"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Source",
        items=(("CAMERA", "Camera", "A camera of this computer"), ("FILE", "File", "A video that plays as a camera")),
    )
    camera: StringProperty(name="Camera", description="Its number or name", default="0")
    filepath: StringProperty(name="File", description="The video", subtype="FILE_PATH")
    focal_mm: FloatProperty(
        name="Focal Length",
        subtype="DISTANCE_CAMERA",
        description="Of the camera for a film 36 mm wide; 0: guessed, which is wrong in the distance only",
        min=0,
        soft_max=120,
    )
    is_picture_mirrored: BoolProperty(name="Mirrored Picture", description="The camera mirrors its picture")

    @classmethod
    def poll(cls, context):
        """Enable it once packages, PyAV and the tracker's networks are there, and nothing runs."""
        if missing_requirements():
            cls.poll_message_set("Python packages are missing: press Install Packages at the top of the LiveHand tab")
            return False
        if missing_of(CAMERA):
            cls.poll_message_set("Live hands need PyAV: press Install Packages in the Video panel")
            return False
        if not has_networks():
            cls.poll_message_set("The hand tracker is missing: press Get Hand Tracker in the Video panel")
            return False
        return LiveSession.running is None

    def invoke(self, context, _event):
        """Ask for the camera."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw the settings of the chosen source."""
        self.layout.use_property_split = True
        self.layout.prop(self, "kind")
        self.layout.prop(self, "camera" if self.kind == "CAMERA" else "filepath")
        self.layout.prop(self, "focal_mm")
        self.layout.prop(self, "is_picture_mirrored")

    def execute(self, context):
        """Start; Blender then calls `modal` by a timer."""
        if context.window is None:
            self.report({"ERROR"}, "live hands need Blender's window; run Blender without --background")
            return {"CANCELLED"}
        is_file = self.kind == "FILE"
        name = str(Path(bpy.path.abspath(self.filepath))) if is_file else self.camera
        setup = LiveSetup(CameraSource(name, is_file), self.focal_mm, self.is_picture_mirrored)
        try:
            self._session = LiveSession.start(setup)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._is_doubted = False
        self._timer = context.window_manager.event_timer_add(_INTERVAL_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Take a step a tick; the session ends with Esc, its file, its camera, or when another ends it."""
        if LiveSession.running is not self._session:
            return self._ended(context)
        if event.type == "ESC":
            return self._ended(context)
        if event.type == "TIMER":
            try:
                self._session.step(context)
            except LiveHandError as error:
                self.report({"ERROR"}, str(error))
                return self._ended(context)
            except BaseException:
                self._ended(context)
                raise
            self._warn(context)
            if self._session.has_ended:
                return self._ended(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Stop when the window was closed: nothing can be keyed any more."""
        context.window_manager.event_timer_remove(self._timer)
        if LiveSession.running is self._session:
            LiveSession.stop()

    def _warn(self, context: bpy.types.Context) -> None:
        """Report what speaks against the hands when something begins to; the panel shows it as long as it does."""
        doubts = self._session.doubts
        if doubts and not self._is_doubted:
            self.report({"WARNING"}, "; ".join(doubts))
        if bool(doubts) != self._is_doubted and context.area is not None:
            context.area.tag_redraw()
        self._is_doubted = bool(doubts)

    def _ended(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        if LiveSession.running is self._session:
            try:
                _end(context, self)
            finally:
                LiveSession.stop()
        return {"FINISHED"}


class _WhileLive:
    """Mixin of operators that need a session."""

    @classmethod
    def poll(cls, context):
        """Enable it while hands follow a camera."""
        return LiveSession.running is not None


class LIVEHAND_OT_live_record(_WhileLive, bpy.types.Operator):
    """Keep what the camera shows from now on; pressed again, fit all of it and key it."""

    bl_idname = "livehand.live_record"
    bl_label = "Record Hands"

    @reports_errors
    def execute(self, context):
        """Begin, or key what was kept as one undo step."""
        session = LiveSession.running
        assert session is not None
        if session.is_recording:
            _key(context, self, session)
        else:
            session.record(context.scene)


class LIVEHAND_OT_live_stop(_WhileLive, bpy.types.Operator):
    """Stop to follow the camera; what is recorded is keyed."""

    bl_idname = "livehand.live_stop"
    bl_label = "Stop"

    def execute(self, context):
        """Key what is recorded, and end the session."""
        try:
            _end(context, self)
        finally:
            LiveSession.stop()
        return {"FINISHED"}


CLASSES = (LIVEHAND_OT_live, LIVEHAND_OT_live_record, LIVEHAND_OT_live_stop)


def draw_live(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Start, or record and stop; or install what that needs."""
    session = LiveSession.running
    if missing_of(CAMERA):
        draw_packages(layout, context, "CAMERA")
        return
    if session is None:
        layout.operator("livehand.live", text="Live", icon="OUTLINER_OB_CAMERA")
        return
    row = layout.row(align=True)
    text = "Key Recording" if session.is_recording else "Record"
    row.operator("livehand.live_record", text=text, icon="REC", depress=session.is_recording)
    row.operator("livehand.live_stop", icon="X")
    for line in (line for doubt in session.doubts for line in textwrap.wrap(doubt, _LINE_CHARACTERS)):
        layout.label(text=line, icon="ERROR")


def _end(context: bpy.types.Context, operator: bpy.types.Operator) -> None:
    """Key what a session that ends has recorded."""
    session = LiveSession.running
    if session is not None and session.is_recording:
        try:
            _key(context, operator, session)
        except LiveHandError as error:
            operator.report({"ERROR"}, str(error))


def _key(context: bpy.types.Context, operator: bpy.types.Operator, session: LiveSession) -> None:
    keyed = session.key(context)
    bpy.ops.ed.undo_push(message="Record Hands")
    for doubt in keyed.doubts:
        operator.report({"WARNING"}, doubt)
    operator.report({"INFO"}, f"Keyed {keyed.frames} frames")
