"""Import of hand motions, and the panel of both ways."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.motion.import_options import ImportOptions, motion_and_warning, with_options
from ...backend.motion.open_files import open_files
from ...backend.motion.summary import file_summary
from ...backend.records.errors import LiveHandError
from ..motion.keying import Placement, key_motion
from ..retarget.importing import RIG_SUFFIXES
from ..retarget.take import TakeRequest, key_take
from . import motion_export, motion_files
from .active_hand import HandTab, OnHand, model_of, polled_hand
from .motion_settings import MotionSettings

_LINE_CHARACTERS = 40  # what the side panel of the file browser shows without cutting it
_LARGEST_SHOWN_BYTES = 64 << 20  # what the file browser reads by itself; larger files are read when they are imported


class LIVEHAND_OT_import_motion(OnHand, MotionSettings, bpy.types.Operator, ImportHelper):
    """Key the active hand with the poses, landmarks or animated rig of a file."""

    bl_idname = "livehand.import_motion"
    bl_label = "Import Hand Motion"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".npz"
    # Forgotten after each import, so that only a dropped file has one when it begins.
    filepath: StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default=motion_files.PATTERN, options={"HIDDEN"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context, event):
        """A dropped file asks for its settings; else the file browser does."""
        self.start_frame = context.scene.frame_current
        return self.invoke_popup(context)

    def draw(self, context):
        """What was detected, then the settings."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        told = layout.box().column(align=True)
        told.scale_y = 0.8
        for line in self._detected():
            told.label(text=line)
        self.draw_settings(layout)

    def execute(self, context):
        """Read everything first, so that an error leaves the scene as it was."""
        read = self._key_rig if _is_rig(self._paths()) else self._key_poses
        try:
            told, doubt = read(context, polled_hand(context))
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if doubt:
            self.report({"WARNING"}, f"Check the motion: {doubt}")
        self.report({"INFO"}, f"Keyed {told} from frame {self.start_frame}")
        return {"FINISHED"}

    def _key_poses(self, context: bpy.types.Context, armature: bpy.types.Object) -> tuple[str, str | None]:
        """What was keyed, and what speaks against the reading."""
        model, model_path = model_of(armature)
        options = self._options()
        file = with_options(open_files(self._paths()), options)
        motion, doubt = motion_and_warning(file, options, model, model_path)
        placement = replace(
            self._placement(),
            space=file.info.space,
            keys_place=self.key_place and file.info.has_translation,
            camera=self._camera(context.scene),
        )
        count = key_motion(context.scene, armature, model, motion, placement)
        return f"{count} frames of {file.info.format}", doubt

    def _key_rig(self, context: bpy.types.Context, armature: bpy.types.Object) -> tuple[str, None]:
        """As `_key_poses`, of an armature in a file."""
        if len(self._paths()) > 1:
            raise LiveHandError(f"a rig's motion must be one file, got {len(self._paths())}; import them one by one")
        side, unit = (None if value == "AUTO" else value for value in (self.side, self.unit))
        request = TakeRequest(self._paths()[0], side, unit, self.fps or None)
        model, _ = model_of(armature)
        count, name = key_take(context, armature, model, request, self._placement())
        return f"{count} frames of {name}", None

    def _placement(self) -> Placement:
        return Placement(
            "z_up", self.start_frame, self.match_fps, self.mirror, self.key_wrist, self.key_place, self.set_shape
        )

    def _paths(self) -> list[Path]:
        folder = Path(bpy.path.abspath(self.directory)) if self.directory else None
        named = [folder / entry.name for entry in self.files if entry.name] if folder else []
        return sorted(named) or [Path(bpy.path.abspath(self.filepath))]

    def _options(self) -> ImportOptions:
        fields = {name: getattr(self, name) for name in ("side", "space", "unit") if getattr(self, name) != "AUTO"}
        if self.mean != "AUTO":
            fields["has_mean_added"] = self.mean == "ADDED"
        if self.angles != "AUTO":
            fields["pca_components"] = 45 if self.angles == "COMPONENTS" else 0
        if self.fps:
            fields["fps"] = self.fps
        mano_path = Path(bpy.path.abspath(self.mano_path)) if self.mano_path else None
        return ImportOptions(fields, mano_path, self.is_picture_mirrored, self.smooth_frames)

    def _camera(self, scene: bpy.types.Scene) -> np.ndarray | None:
        if not self.through_camera:
            return None
        if scene.camera is None:
            raise LiveHandError("Through Camera must have a camera in the scene, got none; add one or turn it off")
        return np.array(scene.camera.matrix_world.normalized())

    def _detected(self) -> list[str]:
        """What the chosen file was taken for, in lines; read once, and again when it changes."""
        paths = [path for path in self._paths() if path.is_file()]
        if not paths:
            return ["Choose a file"]
        if sum(path.stat().st_size for path in paths) > _LARGEST_SHOWN_BYTES:
            return ["A large file: it is read when it is imported"]
        if _is_rig(paths):
            return ["An armature: read by Blender's importer", "The hand's bones are found by name or shape"]
        key = [(str(path), path.stat().st_mtime_ns) for path in paths]
        if getattr(self, "_told_key", None) != key:
            self._told_key, self._told = key, _told(paths)
        return self._told


class LIVEHAND_PT_motion(HandTab, bpy.types.Panel):
    """Motions of the active hand."""

    bl_label = "Motion"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """In and out."""
        self.layout.operator("livehand.import_motion", text="Import Motion", icon="IMPORT")
        self.layout.operator("livehand.export_motion", text="Export Motion", icon="EXPORT")


CLASSES = (LIVEHAND_OT_import_motion, *motion_export.CLASSES, *motion_files.CLASSES, LIVEHAND_PT_motion)


def _is_rig(paths: list[Path]) -> bool:
    return any(path.suffix.lower() in RIG_SUFFIXES for path in paths)


def _told(paths: list[Path]) -> list[str]:
    try:
        facts = [f"{name.capitalize()}: {value}" for name, value in file_summary(open_files(paths)).items()]
    except LiveHandError as error:
        facts = [str(error)]
    return [line for fact in facts for line in textwrap.wrap(fact, _LINE_CHARACTERS)]
