"""What the import of a motion asks: how the file is read, and how the motion comes onto the hand."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

_AUTO = ("AUTO", "As Detected", "As the file's format says")
_READING = ("side", "mean", "angles", "space", "through_camera", "unit", "fps", "mano_path")
_LANDMARKS = ("is_picture_mirrored", "smooth_frames")
_ONTO_HAND = ("start_frame", "match_fps", "mirror", "key_wrist", "key_place", "set_shape")


class MotionSettings:
    """Of the operator: its properties, and how they are drawn."""

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

    def draw_settings(self, layout: bpy.types.UILayout) -> None:
        """What can be changed, then how it comes onto the hand."""
        for title, names in (("Reading", _READING), ("Landmarks", _LANDMARKS), ("Onto the Hand", _ONTO_HAND)):
            layout.label(text=title)
            column = layout.column()
            for name in names:
                column.prop(self, name)
