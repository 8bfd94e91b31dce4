"""Import and export of hand motions: operators, their panels and menu entries, and files dropped into a window."""

from __future__ import annotations

import textwrap
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ...backend.errors import LiveHandError
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand, load_hand_model
from ...backend.pose_files.describe import describe
from ...backend.pose_files.formats.own import write_motion
from ..motion.keying import Placement, key_motion, sample_motion
from ..motion.request import Changes, changed, motion_from, open_files
from .on_hand import HandTab, OnHand, active_hand

_POSES, _LANDMARKS = ".npz;.npy;.pkl", ".json;.csv"
_PATTERN = "*.npz;*.npy;*.pkl;*.json;*.csv"
_AUTO = ("AUTO", "As Detected", "As the file's format says")
_LINE_CHARACTERS = 40  # what the side panel of the file browser shows without cutting it
_LARGEST_SHOWN_BYTES = 64 << 20  # what the file browser reads by itself; larger files are read when they are imported


class LIVEHAND_OT_import_motion(OnHand, bpy.types.Operator, ImportHelper):
    """Key the active hand with the poses or landmarks of a file."""

    bl_idname = "livehand.import_motion"
    bl_label = "Import Hand Motion"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".npz"
    # Forgotten after each import, so that only a dropped file has one when it begins.
    filepath: StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default=_PATTERN, options={"HIDDEN"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})

    side: EnumProperty(
        name="Hand",
        description="Which hand to read; of a file with one hand, which it really is",
        items=(_AUTO, ("right", "Right", "The right hand"), ("left", "Left", "The left hand")),
    )
    mean: EnumProperty(
        name="Mean",
        description="Whether the finger angles are absolute or count from MANO's mean pose",
        items=(
            _AUTO,
            ("ADDED", "In the Angles", "The angles are absolute (flat_hand_mean=True)"),
            ("MISSING", "To Be Added", "The angles count from MANO's mean (flat_hand_mean=False)"),
        ),
    )
    angles: EnumProperty(
        name="Angles",
        description="What the numbers of the fingers are",
        items=(
            _AUTO,
            ("ANGLES", "Axis-Angle", "Three numbers for each joint"),
            ("COMPONENTS", "Components", "Coefficients of MANO's principal components"),
        ),
    )
    space: EnumProperty(
        name="Axes",
        description="The space that the wrist moves in; all but the hand's own are brought into Blender's world",
        items=(
            _AUTO,
            ("hand", "Hand's Own", "As the rig has it: the motion follows the armature object"),
            ("z_up", "Z Up", "A world whose Z points up, as Blender's"),
            ("y_up", "Y Up", "A world whose Y points up"),
            ("opencv", "Camera, Y Down", "A camera's: x right, y down, z forward"),
            ("opengl", "Camera, Y Up", "A camera's: x right, y up, z back"),
        ),
    )
    through_camera: BoolProperty(
        name="Through Camera",
        description="A camera's axes are those of the scene's camera as it stands now; off: of one at the origin",
    )
    unit: EnumProperty(
        name="Unit",
        description="Of the wrist's location",
        items=(_AUTO, ("m", "Meters", ""), ("cm", "Centimeters", ""), ("mm", "Millimeters", "")),
    )
    fps: FloatProperty(name="File Rate", description="Frames per second; 0: as detected", min=0, soft_max=120)
    is_picture_mirrored: BoolProperty(
        name="Mirrored Picture", description="Landmarks were tracked in a selfie's mirror image; turn them back"
    )
    smooth_frames: FloatProperty(
        name="Smoothing",
        description="Frames over which the jitter of landmarks is smoothed; 0: not at all",
        min=0,
        soft_max=5,
        default=1,
    )
    mano_path: StringProperty(
        name="MANO File",
        description="Your MANO_RIGHT.pkl or MANO_LEFT.pkl, for poses that count from its mean or components; empty for "
        "the hand's own model",
        subtype="FILE_PATH",
    )
    start_frame: IntProperty(name="Start Frame", description="Frame of the first key", default=1)
    match_fps: BoolProperty(
        name="Keep Speed", description="Convert to the scene's frame rate; off: one key a frame", default=True
    )
    mirror: BoolProperty(name="Mirror", description="Mirror a motion of the other hand, instead of refusing it")
    key_wrist: BoolProperty(name="Wrist Rotation", description="Key the wrist's rotation", default=True)
    key_place: BoolProperty(name="Wrist Location", description="Key the wrist's location", default=True)
    set_shape: BoolProperty(name="Shape", description="Give the hand the file's shape (its mean)")

    def invoke(self, context, event):
        """A dropped file asks for its settings; else the file browser does."""
        self.start_frame = context.scene.frame_current
        return self.invoke_popup(context)

    def draw(self, context):
        """What was detected, then what can be changed, then how it comes onto the hand."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        told = layout.box().column(align=True)
        told.scale_y = 0.8
        for line in self._detected():
            told.label(text=line)
        _draw_group(
            layout, self, "Reading", ("side", "mean", "angles", "space", "through_camera", "unit", "fps", "mano_path")
        )
        _draw_group(layout, self, "Landmarks", ("is_picture_mirrored", "smooth_frames"))
        onto = ("start_frame", "match_fps", "mirror", "key_wrist", "key_place", "set_shape")
        _draw_group(layout, self, "Onto the Hand", onto)

    def execute(self, context):
        """Read everything first, so that an error leaves the scene as it was."""
        armature = active_hand(context)
        try:
            model, model_path = _model_of(armature)
            changes = self._changes()
            file = changed(open_files(self._paths()), changes)
            motion, doubt = motion_from(file, changes, model, model_path)
            placement = Placement(
                file.reading.space,
                self.start_frame,
                self.match_fps,
                self.mirror,
                self.key_wrist,
                self.key_place and file.reading.has_place,
                self.set_shape,
                self._camera(context.scene),
            )
            count = key_motion(context.scene, armature, model, motion, placement)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if doubt:
            self.report({"WARNING"}, f"Check the motion: {doubt}")
        self.report({"INFO"}, f"Keyed {count} frames of {file.reading.format} from frame {self.start_frame}")
        return {"FINISHED"}

    def _paths(self) -> list[Path]:
        folder = Path(bpy.path.abspath(self.directory)) if self.directory else None
        named = [folder / entry.name for entry in self.files if entry.name] if folder else []
        return sorted(named) or [Path(bpy.path.abspath(self.filepath))]

    def _changes(self) -> Changes:
        fields = {name: getattr(self, name) for name in ("side", "space", "unit") if getattr(self, name) != "AUTO"}
        if self.mean != "AUTO":
            fields["has_mean_added"] = self.mean == "ADDED"
        if self.angles != "AUTO":
            fields["pca_components"] = 45 if self.angles == "COMPONENTS" else 0
        if self.fps:
            fields["fps"] = self.fps
        mano_path = Path(bpy.path.abspath(self.mano_path)) if self.mano_path else None
        return Changes(fields, mano_path, self.is_picture_mirrored, self.smooth_frames)

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
        key = [(str(path), path.stat().st_mtime_ns) for path in paths]
        if getattr(self, "_told_key", None) != key:
            self._told_key, self._told = key, _told(paths)
        return self._told


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


class _Drop:
    bl_import_operator = "livehand.import_motion"

    @classmethod
    def poll_drop(cls, context):
        """In the 3D view, onto a hand."""
        return context.area is not None and context.area.type == "VIEW_3D" and active_hand(context) is not None


class LIVEHAND_FH_poses(_Drop, bpy.types.FileHandler):
    """Pose files dropped into the 3D view."""

    bl_idname = "LIVEHAND_FH_poses"
    bl_label = "Hand Poses"
    bl_file_extensions = _POSES


class LIVEHAND_FH_landmarks(_Drop, bpy.types.FileHandler):
    """Landmarks and data sets' JSON dropped into the 3D view."""

    bl_idname = "LIVEHAND_FH_landmarks"
    bl_label = "Hand Landmarks or Poses"
    bl_file_extensions = _LANDMARKS


class LIVEHAND_PT_motion(HandTab, bpy.types.Panel):
    """Motions of the active hand."""

    bl_label = "Motion"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """In and out."""
        self.layout.operator("livehand.import_motion", text="Import Motion", icon="IMPORT")
        self.layout.operator("livehand.export_motion", text="Export Motion", icon="EXPORT")


CLASSES = (
    LIVEHAND_OT_import_motion,
    LIVEHAND_OT_export_motion,
    LIVEHAND_FH_poses,
    LIVEHAND_FH_landmarks,
    LIVEHAND_PT_motion,
)


def add_to_menus() -> None:
    """File > Import and File > Export."""
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)


def remove_from_menus() -> None:
    """Undo `add_to_menus`."""
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)


def _draw_import(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.import_motion", text="LiveHand Motion (.npz, .json, ...)")


def _draw_export(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.export_motion", text="LiveHand Motion (.npz)")


def _draw_group(layout: bpy.types.UILayout, operator: bpy.types.Operator, title: str, names: tuple[str, ...]) -> None:
    layout.label(text=title)
    column = layout.column()
    for name in names:
        column.prop(operator, name)


def _told(paths: list[Path]) -> list[str]:
    try:
        facts = [f"{name.capitalize()}: {value}" for name, value in describe(open_files(paths)).items()]
    except LiveHandError as error:
        facts = [str(error)]
    return [line for fact in facts for line in textwrap.wrap(fact, _LINE_CHARACTERS)]


def _model_of(armature: bpy.types.Object) -> tuple[HandModel, Path | None]:
    path = armature.livehand.model_path
    if not path:
        return load_default_hand(), None
    file = Path(bpy.path.abspath(path, library=armature.library))
    return load_hand_model(file), file
