"""A text summary of a motion file, for `livehand inspect` and Blender's file browser."""

from __future__ import annotations

from ..landmarks.landmark_file import LandmarkFile
from ..landmarks.take_file import TakeFile
from .open_files import MotionFile

_AXES = {
    "hand": "the hand's own",
    "z_up": "world, Z up",
    "y_up": "world, Y up",
    "opencv": "camera, y down, z forward",
    "opengl": "camera, y up, z back",
}


def file_summary(file: MotionFile) -> dict[str, str]:
    """Word how the file is interpreted, by label; notes are numbered."""
    info = file.info
    facts = {
        "format": info.format,
        "hand": " and ".join(file.sides) + (f" ({info.side} is read)" if len(file.sides) > 1 else ""),
        "frames": f"{info.frames}" + (f", {info.missing} of them without a hand" if info.missing else ""),
        "fps": f"{info.fps:g}" if info.fps else "not in the file",
        "axes": _AXES[info.space],
        "place": "in the file" if info.has_translation else "not in the file: the wrist does not move",
    }
    if isinstance(file, LandmarkFile | TakeFile):
        facts["picture"] = "mirrored" if file.is_picture_mirrored else "not mirrored"
    else:
        facts["mean"] = "in the angles" if info.has_mean_added else "to be added (needs a MANO file)"
        count = info.pca_components
        facts["angles"] = f"{count} components (needs a MANO file)" if count else "axis-angle"
    return facts | {f"note {number}": note for number, note in enumerate(info.notes, 1)}
