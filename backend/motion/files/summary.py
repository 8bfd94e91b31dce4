"""A text summary of a motion file, for `livehand inspect` and Blender's file browser."""

from __future__ import annotations

from ...hand.model_file import load_default_hand
from ...records.errors import LiveHandError
from ..landmarks.landmark_file import LandmarkFile
from ..landmarks.take_file import TakeFile
from ..pose_file import FileInfo, PoseFile
from .import_options import ImportOptions, motion_and_warning
from .open_files import MotionFile

_AXES = {
    "hand": "the hand's own",
    "z_up": "world, Z up",
    "y_up": "world, Y up",
    "opencv": "camera, y down, z forward",
    "opengl": "camera, y up, z back",
}


def file_summary(file: MotionFile, fits_landmarks: bool = False) -> dict[str, str]:
    """Word how the file is interpreted and what speaks against it, by label; notes are numbered.

    Landmarks are checked only where they are to be fitted, which takes its time.
    """
    info = file.info
    facts = {
        "format": info.format,
        "hand": " and ".join(file.sides) + (f" ({info.side} is read)" if len(file.sides) > 1 else ""),
        "frames": _frames(info),
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
    is_checked = fits_landmarks or isinstance(file, PoseFile)
    if is_checked and (doubt := _doubts(file)):
        facts["check"] = doubt
    return facts | {f"note {number}": note for number, note in enumerate(info.notes, 1)}


def _frames(info: FileInfo) -> str:
    """Count the frames; a hand that comes later than the file begins is told by its first frame, from 1."""
    late = f", from the file's {info.first + 1} on" if info.first else ""
    return f"{info.frames}{late}" + (f", {info.missing} of them without a hand" if info.missing else "")


def _doubts(file: MotionFile) -> str:
    """Word what speaks against every hand of a file, on the built-in hand; empty: nothing."""
    found = {side: _doubt(file.with_changes(side=side) if len(file.sides) > 1 else file) for side in file.sides}
    if len(found) == 1:
        return next(iter(found.values())) or ""
    return "; ".join(f"the {side} hand: {doubt}" for side, doubt in found.items() if doubt)


def _doubt(file: MotionFile) -> str | None:
    try:
        return motion_and_warning(file, ImportOptions(), load_default_hand(), None)[1]
    except LiveHandError as error:
        return f"the poses are not checked: {error}"
