"""An avatar of one's own hand, made of a film or of photographs while Blender goes on."""

from __future__ import annotations

from itertools import chain, count
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.person.command import start_person
from ...backend.person.kept_steps import remove_work
from ...backend.person.sources import FILM_SUFFIXES
from ...backend.system.child_job import ChildJob
from ...backend.system.packages import PICTURES, missing_of
from ..render.hand_source import set_avatar
from ..rig.hand import active_hand
from .jobs import RunsJob
from .mixins import NeedsTracker
from .packages import draw_offer
from .preferences import library_folder

_SIDES = (
    ("AUTO", "Automatic", "The hand that is seen longer"),
    ("right", "Right", "The right hand"),
    ("left", "Left", "The left hand"),
)


class LIVEHAND_OT_person_from_pictures(NeedsTracker, RunsJob, bpy.types.Operator, ImportHelper):
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

    def start(self, context: bpy.types.Context) -> ChildJob:
        """Start the command, which writes a new avatar."""
        source = _source(Path(bpy.path.abspath(self.filepath)))
        name = bpy.path.clean_name(self.person_name or source.stem)
        self._output = _free_path(library_folder(context), name)
        arguments = [str(source), "-o", str(self._output), "--name", self.person_name or source.stem]
        arguments += ["--consent", self.consent] if self.consent else []
        arguments += ["--side", self.side] if self.side != "AUTO" else []
        return start_person([*arguments, "--sheet", str(self._output.with_suffix(".png"))])

    def cancel(self, context):
        """Stop; what was kept to go on is removed."""
        super().cancel(context)
        remove_work(self._output)

    def take(self, context: bpy.types.Context, job: ChildJob) -> None:
        """Let the active hand wear the avatar, in one step of undo."""
        result = job.result()
        armature = active_hand(context)
        if armature is not None:
            set_avatar(armature, self._output)
            bpy.ops.ed.undo_push(message=self.bl_label)
        self.report({"INFO"}, f"{self._output.stem}: {result['seen']:.0%} of the skin was seen")
        for note in result["notes"]:
            self.report({"WARNING"}, str(note))


def draw_person(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button, or one that installs what it needs: nothing is wrong where few want it."""
    if missing_of(PICTURES):
        draw_offer(layout, context, "PICTURES", "Film or Photographs")  # and their size: a narrow tab has no more room
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
