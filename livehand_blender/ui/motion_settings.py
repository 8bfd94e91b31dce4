"""Settings of a motion import: how the file is read, and how the motion is transferred to the hand."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

_AUTO = ("AUTO", "As Detected", "As detected from the file")
_READING = ("side", "mean", "angles", "space", "through_camera", "unit", "fps", "mano_path")
_LANDMARKS = ("is_picture_mirrored", "smooth_frames")
_FIRST = ("start_frame", "match_fps", "mirror")
_TRANSFER = ("key_wrist", "key_place", "set_shape")


class MotionSettings:
    """Mixin of the import operator: its properties, and how they are drawn."""

    side: EnumProperty(
        name="Hand",
        description="Which hand to read; corrects the label of a file with one hand",
        items=(_AUTO, ("right", "Right", "The right hand"), ("left", "Left", "The left hand")),
    )
    mean: EnumProperty(
        name="Mean Pose",
        description="Whether the finger angles are absolute or relative to MANO's mean pose",
        items=(
            _AUTO,
            ("ADDED", "In the Angles", "The angles are absolute (flat_hand_mean=True)"),
            ("MISSING", "To Be Added", "The angles are relative to MANO's mean (flat_hand_mean=False)"),
        ),
    )
    angles: EnumProperty(
        name="Pose Format",
        description="How the finger poses are stored",
        items=(
            _AUTO,
            ("ANGLES", "Axis-Angle", "Three numbers for each joint"),
            ("COMPONENTS", "Components", "Coefficients of MANO's principal components"),
        ),
    )
    space: EnumProperty(
        name="Axes",
        description="Coordinate system of the wrist's motion; converted to Blender's world unless it is the hand's own",
        items=(
            _AUTO,
            ("hand", "Same as Hand", "The rig's own: the motion moves with the armature object"),
            ("z_up", "Z Up", "A world whose Z axis points up, like Blender's"),
            ("y_up", "Y Up", "A world whose Y axis points up"),
            ("opencv", "Camera, Y Down", "A camera: x right, y down, z forward"),
            ("opengl", "Camera, Y Up", "A camera: x right, y up, z back"),
        ),
    )
    through_camera: BoolProperty(
        name="Through Camera",
        description="Camera axes are those of the scene's camera in the current frame; off: of a camera at the origin",
    )
    unit: EnumProperty(
        name="Unit",
        description="Unit of the wrist's location",
        items=(_AUTO, ("m", "Meters", ""), ("cm", "Centimeters", ""), ("mm", "Millimeters", "")),
    )
    fps: FloatProperty(name="File Rate", description="Frames per second; 0: as detected", min=0, soft_max=120)
    is_picture_mirrored: BoolProperty(
        name="Mirrored Picture",
        description="The landmarks were tracked in a mirrored picture (selfie); mirror them back",
    )
    smooth_frames: FloatProperty(
        name="Smoothing",
        description="Number of frames over which the landmarks are smoothed; 0: no smoothing",
        min=0,
        soft_max=5,
        default=1,
    )
    mano_path: StringProperty(
        name="MANO Model",
        description="Your MANO_RIGHT.pkl or MANO_LEFT.pkl, for poses relative to its mean or in its components; empty: "
        "use the hand's own model",
        subtype="FILE_PATH",
    )
    start_frame: IntProperty(name="Start Frame", description="Frame of the first key", default=1)
    match_fps: BoolProperty(
        name="Keep Speed", description="Resample to the scene's frame rate; off: one key per frame", default=True
    )
    mirror: BoolProperty(name="Mirror", description="Mirror a motion of the other hand; off: report an error")
    key_wrist: BoolProperty(name="Wrist Rotation", description="Key the wrist's rotation", default=True)
    key_place: BoolProperty(name="Wrist Location", description="Key the wrist's location", default=True)
    set_shape: BoolProperty(name="Shape", description="Give the hand the file's shape, or its mean if it changes")

    def draw_settings(self, layout: bpy.types.UILayout) -> None:
        """Draw where the motion goes and, in a panel that is closed at first, all else: files tell most of it."""
        _draw(self, layout, _FIRST)
        header, body = layout.panel("LIVEHAND_import_advanced", default_closed=True)
        header.label(text="Advanced")
        if body is not None:
            for title, names in (("Reading", _READING), ("Landmarks", _LANDMARKS), ("Transfer", _TRANSFER)):
                body.label(text=title)
                _draw(self, body, names)


def _draw(settings: MotionSettings, layout: bpy.types.UILayout, names: tuple[str, ...]) -> None:
    column = layout.column()
    for name in names:
        column.prop(settings, name)
