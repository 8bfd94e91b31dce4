"""A reading in words, for `livehand inspect` and for Blender's file browser."""

from __future__ import annotations

from .landmarks.landmark_file import LandmarkFile
from .open_files import MotionFile

_AXES = {
    "hand": "the hand's own",
    "z_up": "world, Z up",
    "y_up": "world, Y up",
    "opencv": "camera, y down, z forward",
    "opengl": "camera, y up, z back",
}


def describe(file: MotionFile) -> dict[str, str]:
    """What the file was taken for, by names for people; notes are numbered."""
    reading = file.reading
    facts = {
        "format": reading.format,
        "hand": " and ".join(file.sides) + (f" ({reading.side} is read)" if len(file.sides) > 1 else ""),
        "frames": f"{reading.frames}" + (f", {reading.missing} of them without a hand" if reading.missing else ""),
        "fps": f"{reading.fps:g}" if reading.fps else "not in the file",
        "axes": _AXES[reading.space],
        "place": "in the file" if reading.has_place else "not in the file: the wrist stays where it is",
    }
    if isinstance(file, LandmarkFile):
        facts["picture"] = "mirrored" if file.is_picture_mirrored else "not mirrored"
    else:
        facts["mean"] = "in the angles" if reading.has_mean_added else "to be added (needs a MANO file)"
        count = reading.pca_components
        facts["angles"] = f"{count} components (needs a MANO file)" if count else "axis-angle"
    return facts | {f"note {number}": note for number, note in enumerate(reading.notes, 1)}
