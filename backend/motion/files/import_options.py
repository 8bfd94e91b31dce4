"""The user's options of a motion import, and the motion they lead to; independent of Blender."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...hand.model import HandModel
from ..gate import motion_doubts
from ..landmarks.landmark_file import LandmarkFile
from ..landmarks.picture_camera import PictureCamera
from ..landmarks.take_file import TakeFile, take_doubts
from ..mano_basis import find_basis
from ..motion import HandMotion
from ..resampling import smoothed
from .open_files import MotionFile

_POSE_FILES_ONLY = ("has_mean_added", "pca_components")


@dataclass(frozen=True)
class ImportOptions:
    """Corrections to what was detected in the file, and settings of the fit.

    Attributes:
        changes: fields of `FileInfo`, by name.
        mano_path: MANO's own file, for its mean and components; None takes the hand's own, if it has them.
        is_picture_mirrored: landmarks only: the tracked picture was mirrored.
        smooth_frames: landmarks only: standard deviation of the smoothing, in frames.
        picture_camera: landmarks in a picture only: its camera.
    """

    changes: Mapping[str, Any] = field(default_factory=dict)
    mano_path: Path | None = None
    is_picture_mirrored: bool = False
    smooth_frames: float = 0.0
    picture_camera: PictureCamera | None = None


def with_options(file: MotionFile, options: ImportOptions) -> MotionFile:
    """Apply the user's corrections to the file.

    Raises:
        LiveHandError: a value is not allowed.
    """
    if isinstance(file, LandmarkFile | TakeFile):
        changes = {name: value for name, value in options.changes.items() if name not in _POSE_FILES_ONLY}
        return file.with_changes(
            is_picture_mirrored=options.is_picture_mirrored, picture_camera=options.picture_camera, **changes
        )
    return file.with_changes(**options.changes)


def motion_and_warning(
    file: MotionFile, options: ImportOptions, model: HandModel, model_path: Path | None
) -> tuple[HandMotion, str | None]:
    """Read the motion of a file returned by `with_options`, and warn if the interpretation looks wrong.

    Args:
        file: with the options applied.
        options: the same options.
        model: the hand model that will play the motion.
        model_path: the model's file; None for the built-in hand.

    Raises:
        LiveHandError: MANO's file is needed and missing, or the landmarks are not those of a hand.
    """
    if isinstance(file, TakeFile):
        fit = file.fit(model)
        return smoothed(fit.motion, options.smooth_frames), take_doubts(fit, model)
    if isinstance(file, LandmarkFile):
        motion, own = file.motion(model, options.smooth_frames), file.warning(model)
    else:
        basis = find_basis(options.mano_path, model_path)
        motion, own = file.motion(basis), file.warning(basis)
    return motion, "; ".join([*([own] if own else []), *motion_doubts(model, motion)]) or None
