"""Import and export of hand motions, and their panel."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ...backend.motion.files.import_options import ImportOptions, motion_and_warning, with_options
from ...backend.motion.files.open_files import open_files
from ...backend.motion.files.summary import file_summary
from ...backend.motion.formats.own import write_motion
from ...backend.motion.landmarks.picture_camera import PictureCamera
from ...backend.motion.landmarks.take_file import TakeFile, take_doubts
from ...backend.motion.mano_basis import find_basis
from ...backend.motion.writers.registry import choose_writer
from ...backend.motion.writers.writer import WriteOptions
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side
from ...backend.rigs.rig_suffixes import RIG_SUFFIXES
from ..motion.filmed import key_take
from ..motion.keying import Placement, key_motion, sample_motion
from ..motion.taking import sample_take
from ..render.hand_source import hand_source
from ..rig.hand import RiggedHand, find_hands
from ..rig.sliders import read_beta
from ..rigs.bake import bake_file
from ..rigs.blender_writers import ALL_WRITERS, BLENDER_WRITERS
from ..rigs.importing import RigFile
from ..scene.camera import read_camera
from . import motion_files
from .mixins import FrameRange, HandTab, OnHand, reports_errors
from .motion_settings import MotionSettings

_LINE_CHARACTERS = 40  # as wide as the side panel of the file browser shows
_LARGEST_SHOWN_BYTES = 64 << 20  # the file browser reads no larger files
_HANDS = (
    ("ACTIVE", "Active", "The active hand"),
    ("ALL", "All", "The scene's hands, one of each side; own format and MANO hold one"),
)
_FORMATS = tuple(
    (writer.name, writer.title, f"Files that end in {', '.join(writer.suffixes)}") for writer in ALL_WRITERS
)

_WITH_MESH = tuple(writer.name for writer in BLENDER_WRITERS)


class LIVEHAND_OT_import_motion(OnHand, MotionSettings, bpy.types.Operator, ImportHelper):
    """Key the active hand with poses, landmarks or an animated rig from a file."""

    bl_idname = "livehand.import_motion"
    bl_label = "Import Hand Motion"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".npz"
    # Not saved between imports, so that only a dropped file sets it before the file browser opens.
    filepath: StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default=motion_files.PATTERN, options={"HIDDEN"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context, event):
        """Ask for the settings of a dropped file, or open the file browser."""
        self.start_frame = context.scene.frame_current
        if not self.directory:  # else Blender proposes the name of the .blend
            self.directory = bpy.path.abspath("//") or str(Path.home())
        return self.invoke_popup(context)

    def draw(self, context):
        """Draw the detected format, then the settings."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.box().column(align=True)
        column.scale_y = 0.8
        for line in self._detected():
            column.label(text=line)
        self.draw_settings(layout)

    @reports_errors
    def execute(self, context):
        """Read everything first, so that an error changes nothing."""
        key = self._key_rig if _is_rig(self._paths()) else self._key_poses
        keyed, doubt = key(context, RiggedHand.active(context))
        if doubt:
            self.report({"WARNING"}, f"Check the motion: {doubt}")
        self.report({"INFO"}, f"Keyed {keyed} from frame {self.start_frame}")

    def _key_poses(self, context: bpy.types.Context, hand: RiggedHand) -> tuple[str, str | None]:
        """Key the poses; return what was keyed, and why the file may have been misread."""
        options = replace(self._options(), picture_camera=self._picture_camera(context.scene))
        file = with_options(open_files(self._paths()), options)
        if isinstance(file, TakeFile):
            return self._key_take(context, hand, file)
        motion, doubt = motion_and_warning(file, options, hand.model, hand.model_path)
        placement = replace(
            self._placement(),
            space=file.info.space,
            first=file.info.first,
            keys_place=self.key_place and file.info.has_translation,
            camera=self._camera(context.scene),
        )
        count = key_motion(context.scene, hand, motion, placement)
        late = f", whose hand comes {file.info.first} frames late," if file.info.first else ""
        return f"{count} frames of {file.info.format}{late}", doubt

    def _key_take(self, context: bpy.types.Context, hand: RiggedHand, file: TakeFile) -> tuple[str, str | None]:
        """Key, as `_key_poses`, a filmed take, fitted to the hand's own shape."""
        fit = file.with_changes(beta=read_beta(hand.armature)).fit(hand.model)
        placement = replace(self._placement(), space="opencv", sets_shape=False, camera=self._camera(context.scene))
        count = key_take(context.scene, hand, fit, placement)
        return f"{count} frames of a {file.info.format}", take_doubts(fit, hand.model)

    def _key_rig(self, context: bpy.types.Context, hand: RiggedHand) -> tuple[str, str | None]:
        """Key, as `_key_poses`, an armature in a file."""
        paths = self._paths()
        if len(paths) > 1:
            raise LiveHandError(f"a rig's motion must be one file, got {len(paths)}; import them one by one")
        side, unit = (None if value == "AUTO" else value for value in (self.side, self.unit))
        file = RigFile(paths[0], side, unit, self.fps or None)
        keyed = bake_file(context, hand, file, self._placement())
        return f"{keyed.frames} frames of {keyed.armature}", keyed.doubt

    def _placement(self) -> Placement:
        return Placement(
            "z_up",
            self.start_frame,
            matches_fps=self.match_fps,
            mirrors=self.mirror,
            keys_wrist=self.key_wrist,
            keys_place=self.key_place,
            sets_shape=self.set_shape,
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

    def _picture_camera(self, scene: bpy.types.Scene) -> PictureCamera | None:
        """Read the scene's camera as that of the tracked picture, for landmarks that are points in it."""
        if not self.through_camera or scene.camera is None or scene.camera.data.type != "PERSP":
            return None
        view = read_camera(scene.camera, scene.render)
        width_px = view.size_px[0]
        return PictureCamera(view.size_px, float(np.rad2deg(2 * np.arctan(width_px / 2 / view.K[0, 0]))))

    def _detected(self) -> list[str]:
        """List the detected format of the chosen files, in lines; they are read again only when they change."""
        paths = [path for path in self._paths() if path.is_file()]
        if not paths:
            return ["Choose a file"]
        if sum(path.stat().st_size for path in paths) > _LARGEST_SHOWN_BYTES:
            return ["A large file: it is read during the import"]
        if _is_rig(paths):
            return ["An armature: Blender's importer reads it", "The hand's bones are found by name or shape"]
        key = [(str(path), path.stat().st_mtime_ns) for path in paths]
        if getattr(self, "_detected_key", None) != key:
            self._detected_key, self._detected_lines = key, _described(paths)
        return self._detected_lines


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


class LIVEHAND_OT_export_take(OnHand, FrameRange, bpy.types.Operator, ExportHelper):
    """Write the motion of hands in a range of frames for other programs."""

    bl_idname = "livehand.export_take"
    bl_label = "Export LiveHand Motion"
    bl_options = {"REGISTER"}

    format: EnumProperty(name="Format", description="Format of the file", items=_FORMATS)
    hands: EnumProperty(name="Hands", description="Which hands are written", items=_HANDS)
    from_mean: BoolProperty(name="From Mean", description="Finger angles count from MANO's mean pose", default=False)
    mano_path: StringProperty(name="MANO File", description="Your MANO_RIGHT.pkl or MANO_LEFT.pkl", subtype="FILE_PATH")
    has_skin: BoolProperty(name="Skin", description="The mesh wears the hand's avatar, with textures", default=True)
    texture_px: IntProperty(
        name="Texture Size",
        description="Width and height of the textures",
        default=2048,
        min=16,
        max=8192,
        subtype="PIXEL",
    )
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
        if self.format in _WITH_MESH:
            layout.prop(self, "has_skin")
            column = layout.column()
            column.active = self.has_skin
            column.prop(self, "texture_px")
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
        has_skin = self.has_skin and writer.name in _WITH_MESH
        wearing = hands if has_skin else []
        avatars: dict[Side, Path] = {hand.side: hand_source(hand.armature).avatar_path for hand in wearing}
        options = WriteOptions(self.from_mean and writer.name == "mano", basis, avatars, self.texture_px)
        losses = writer.write(take, path, options)
        if losses:
            self.report({"WARNING"}, f"{writer.title}: {'; '.join(losses)}")
        self.report({"INFO"}, f"Wrote {take.count} frames as {writer.title}")


class LIVEHAND_PT_motion(HandTab, bpy.types.Panel):
    """Motions of the active hand."""

    bl_label = "Motion"

    def draw(self, context):
        """Import and export."""
        self.layout.operator("livehand.import_motion", text="Import Motion", icon="IMPORT")
        self.layout.operator("livehand.export_take", text="Export Motion", icon="EXPORT")


CLASSES = (
    LIVEHAND_OT_import_motion,
    LIVEHAND_OT_export_motion,
    LIVEHAND_OT_export_take,
    *motion_files.CLASSES,
    LIVEHAND_PT_motion,
)


def _is_rig(paths: list[Path]) -> bool:
    return any(path.suffix.lower() in RIG_SUFFIXES for path in paths)


def _described(paths: list[Path]) -> list[str]:
    try:
        facts = [f"{name.capitalize()}: {value}" for name, value in file_summary(open_files(paths)).items()]
    except LiveHandError as error:
        facts = [str(error)]
    return [line for fact in facts for line in textwrap.wrap(fact, _LINE_CHARACTERS)]
