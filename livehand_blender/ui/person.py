"""An avatar of one's own hand, made of a film or of photographs while Blender goes on."""

from __future__ import annotations

from itertools import chain, count
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.person.job import PersonJob
from ...backend.person.sources import FILM_SUFFIXES
from ...backend.records.errors import LiveHandError
from ...backend.system.packages import PICTURES, missing_of
from ..render.hand_source import set_avatar
from ..rig.hand import active_hand
from .mixins import NeedsTracker
from .packages import draw_packages
from .preferences import library_folder

_INTERVAL_S = 0.25
_SIDES = (
    ("AUTO", "Automatic", "The hand that is seen longer"),
    ("right", "Right", "The right hand"),
    ("left", "Left", "The left hand"),
)


class LIVEHAND_OT_person_from_pictures(NeedsTracker, bpy.types.Operator, ImportHelper):
    """Make an avatar of somebody's hand: of a film, or of the photographs in a folder."""

    bl_idname = "livehand.person_from_pictures"
    bl_label = "Avatar from Film or Photographs"
    bl_options = {"REGISTER"}

    filename_ext = ""
    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in (*FILM_SUFFIXES, ".jpg", ".jpeg", ".png")), options={"HIDDEN"}
    )
    person_name: StringProperty(name="Name", description="Of the person; the avatar's file is named by it")
    consent: StringProperty(name="Consent", description="What the person agreed to; kept in the avatar")
    side: EnumProperty(name="Hand", items=_SIDES)

    @classmethod
    def poll(cls, context):
        """Enable it once what it needs is there."""
        if missing_of(PICTURES):
            cls.poll_message_set("Python packages are missing: press Install Packages in the Avatar panel")
            return False
        return super().poll(context)

    def execute(self, context):
        """Start; in a window, Blender then calls `modal` by a timer, else it waits."""
        source = _source(Path(bpy.path.abspath(self.filepath)))
        name = bpy.path.clean_name(self.person_name or source.stem)
        output = _free_path(library_folder(context), name)
        arguments = [str(source), "-o", str(output), "--name", self.person_name or source.stem]
        arguments += ["--consent", self.consent] if self.consent else []
        arguments += ["--side", self.side] if self.side != "AUTO" else []
        self._job = PersonJob.start([*arguments, "--sheet", str(output.with_suffix(".png"))], output)
        if bpy.app.background or context.window is None:
            self._job.wait()
            return self._taken(context)
        self._timer = context.window_manager.event_timer_add(_INTERVAL_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Show what is being done; Esc cancels, and nothing has changed."""
        if event.type == "ESC" and event.value == "PRESS":
            self._job.cancel()
            self._end(context)
            self.report({"INFO"}, "Canceled: no avatar was made")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self._job.is_running:
            context.workspace.status_text_set(f"Avatar from pictures: {self._job.last_line}    (Esc: cancel)")
            return {"PASS_THROUGH"}
        self._end(context)
        return self._taken(context)

    def cancel(self, context):
        """Stop when the window was closed."""
        self._job.cancel()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def _taken(self, context: bpy.types.Context) -> set[str]:
        """Let the active hand wear the avatar, in one step of undo."""
        try:
            result = self._job.result()
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        armature = active_hand(context)
        if armature is not None:
            set_avatar(armature, self._job.output)
            bpy.ops.ed.undo_push(message=self.bl_label)
        self.report({"INFO"}, f"{self._job.output.stem}: {result['seen']:.0%} of the skin was seen")
        for note in result["notes"]:
            self.report({"WARNING"}, str(note))
        return {"FINISHED"}


def draw_person(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button, or how to install what it needs."""
    if missing_of(PICTURES):
        layout.label(text="From Film or Photographs:")
        draw_packages(layout, context, "PICTURES")
    else:
        layout.operator("livehand.person_from_pictures", text="From Film or Photographs", icon="FILE_MOVIE")


def _source(chosen: Path) -> Path:
    """Return the film, or the folder of the photograph that was chosen."""
    return chosen if chosen.suffix.lower() in FILM_SUFFIXES or chosen.is_dir() else chosen.parent


def _free_path(folder: Path, name: str) -> Path:
    """Return a path for the avatar that no other has."""
    endings = chain([""], (f"_{number}" for number in count(2)))
    paths = (folder / f"{name}{ending}.safetensors" for ending in endings)
    return next(path for path in paths if not path.exists())


CLASSES = (LIVEHAND_OT_person_from_pictures,)
