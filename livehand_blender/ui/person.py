"""An avatar of one's own hand, made of a film or of photographs, or of an invented person, while Blender goes on."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, count
from math import degrees, radians
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.person.command import start_person
from ...backend.person.invented.adjust_command import start_adjusting
from ...backend.person.invented.command import start_new_person
from ...backend.person.kept_steps import remove_work
from ...backend.person.sources import FILM_SUFFIXES
from ...backend.surface.people.look import ADJUSTABLE, MOST_SEED, NUMBERS, PERSON_NUMBERS
from ...backend.system.child_job import ChildJob
from ...backend.system.command import FOV_LIMITS_DEG
from ...backend.system.packages import PICTURES, missing_of, missing_requirements
from ..render.hand_source import hand_source, set_avatar
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


def _keep_field_of_view(operator: bpy.types.Operator, _context: bpy.types.Context) -> None:
    """Give a value between not known and the least that the command takes that least one."""
    least = radians(FOV_LIMITS_DEG[0])
    if 0 < operator.field_of_view < least:
        operator.field_of_view = least


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
    length_mm: FloatProperty(
        name="Hand Length",
        description="From the wrist's crease to the tip of the straight middle finger, which one camera cannot see. 0 "
        "is not measured",
        subtype="DISTANCE_CAMERA",
        default=0.0,
        min=0.0,
        soft_max=250.0,
    )
    field_of_view: FloatProperty(
        name="Field of View",
        description="The camera's, horizontal of a film, along the longer side of photographs that do not tell it. "
        "0 is a phone's",
        subtype="ANGLE",
        default=0.0,
        min=0.0,
        max=radians(FOV_LIMITS_DEG[1]),
        update=_keep_field_of_view,
    )

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
        arguments += ["--length-mm", f"{self.length_mm:.3f}"] if self.length_mm > 0 else []
        arguments += ["--fov", f"{degrees(self.field_of_view):.3f}"] if self.field_of_view > 0 else []
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


def _slider(name: str) -> Any:
    """Make the property of one of a person's numbers."""
    spec = NUMBERS[name]
    return FloatProperty(
        name=name.capitalize(), description=spec.meaning, min=spec.low, max=spec.high, default=spec.usual
    )


def _is_adjusted(name: str) -> Any:
    """Make the property that tells whether a number is changed."""
    return BoolProperty(name=f"Change {name.capitalize()}", description="Off: as it is")


class _MakesAvatar(RunsJob):
    """Mixin of operators that make an avatar of a person's numbers; `start` sets `_output`, the avatar's file."""

    _output: Path

    def words_of(self, names: Iterable[str]) -> list[str]:
        """Return the command's arguments for these sliders."""
        return [word for name in names for word in (f"--{name}", str(round(getattr(self, name), 4)))]

    def take(self, context: bpy.types.Context, job: ChildJob) -> None:
        """Let the active hand wear the avatar, in one step of undo."""
        job.result()
        armature = active_hand(context)
        if armature is not None:
            set_avatar(armature, self._output)
            bpy.ops.ed.undo_push(message=self.bl_label)
        self.report({"INFO"}, f"{self._output.stem} is in Choose Avatar")


class LIVEHAND_OT_adjust_person(_MakesAvatar, bpy.types.Operator):
    """Give the active hand's person another tone, age or hair, in an avatar of its own."""

    bl_idname = "livehand.adjust_person"
    bl_label = "Adjust Person"
    bl_options = {"REGISTER"}

    age: _slider("age")
    tone: _slider("tone")
    blood: _slider("blood")
    veins: _slider("veins")
    folds: _slider("folds")
    hair: _slider("hair")
    with_age: _is_adjusted("age")
    with_tone: _is_adjusted("tone")
    with_blood: _is_adjusted("blood")
    with_veins: _is_adjusted("veins")
    with_folds: _is_adjusted("folds")
    with_hair: _is_adjusted("hair")

    @classmethod
    def poll(cls, context):
        """Enable it for a hand, once packages are there."""
        if active_hand(context) is None:
            cls.poll_message_set("Select a hand")
            return False
        if missing_requirements():
            cls.poll_message_set("Python packages are missing: press Install Packages")
            return False
        return True

    def invoke(self, context, event):
        """Ask for the numbers, from those of the person."""
        from ...backend.avatars.file import read_header

        surface = read_header(hand_source(active_hand(context)).avatar_path).get("surface")
        if surface is None:
            self.report({"ERROR"}, "The hand's avatar has no surface to adjust")
            return {"CANCELLED"}
        for name, attribute in PERSON_NUMBERS.items():
            setattr(self, name, surface["person"][attribute])
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw a slider for each number, beside whether it is changed."""
        for name in ADJUSTABLE:
            row = self.layout.row()
            row.prop(self, f"with_{name}", text="")
            slider = row.row()
            slider.enabled = getattr(self, f"with_{name}")
            slider.prop(self, name, slider=True)

    def start(self, context: bpy.types.Context) -> ChildJob:
        """Start the command, which writes a new avatar."""
        source = hand_source(active_hand(context)).avatar_path
        self._output = _free_path(library_folder(context), source.stem)
        changed = [name for name in ADJUSTABLE if getattr(self, f"with_{name}")]
        return start_adjusting([str(source), "-o", str(self._output), *self.words_of(changed)])


class LIVEHAND_OT_new_person(_MakesAvatar, bpy.types.Operator):
    """Make an avatar of an invented person from a few numbers; no one else has their creases, spots and veins."""

    bl_idname = "livehand.new_person"
    bl_label = "New Person"
    bl_options = {"REGISTER"}

    person_name: StringProperty(name="Name", description="Of the person; the avatar's file is named by it")
    seed: IntProperty(name="Seed", description="Of lines, cells, spots and shape", default=1, min=0, max=MOST_SEED)
    age: _slider("age")
    tone: _slider("tone")
    build: _slider("build")
    blood: _slider("blood")
    veins: _slider("veins")
    freckles: _slider("freckles")
    folds: _slider("folds")
    hair: _slider("hair")
    nails: _slider("nails")

    @classmethod
    def poll(cls, context):
        """Enable it once packages are there."""
        if missing_requirements():
            cls.poll_message_set("Python packages are missing: press Install Packages")
            return False
        return True

    def invoke(self, context, event):
        """Ask for the numbers."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        """Draw name, seed and sliders."""
        self.layout.use_property_split = True
        for name in ("person_name", "seed"):
            self.layout.prop(self, name)
        for name in NUMBERS:
            self.layout.prop(self, name, slider=True)

    def start(self, context: bpy.types.Context) -> ChildJob:
        """Start the command, which writes a new avatar."""
        name = self.person_name or f"Person {self.seed}"
        self._output = _free_path(library_folder(context), bpy.path.clean_name(name))
        return start_new_person(
            ["-o", str(self._output), "--name", name, "--seed", str(self.seed), *self.words_of(NUMBERS)]
        )


def draw_person(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons, or one that installs what pictures need: nothing is wrong where few want it."""
    row = layout.row(align=True)
    row.operator("livehand.new_person", icon="ADD")
    row.operator("livehand.adjust_person", icon="MODIFIER")
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


CLASSES = (LIVEHAND_OT_person_from_pictures, LIVEHAND_OT_new_person, LIVEHAND_OT_adjust_person)
