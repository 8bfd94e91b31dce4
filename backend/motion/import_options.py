"""What an import was asked to do, and the motion that follows: no operator, no property of Blender's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..hand.model import HandModel
from .landmarks.landmark_file import LandmarkFile
from .mano_basis import basis_for
from .motion import HandMotion
from .open_files import MotionFile, open_motion_file, open_pose_files


@dataclass(frozen=True)
class Changes:
    """What the user knows better than the file.

    Attributes:
        fields: of `Reading`, by name.
        mano_path: MANO's own file, for its mean and components; None: the hand's own, where it has them.
        is_picture_mirrored: of landmarks.
        smooth_frames: of landmarks: how far jitter is smoothed.
    """

    fields: Mapping[str, Any] = field(default_factory=dict)
    mano_path: Path | None = None
    is_picture_mirrored: bool = False
    smooth_frames: float = 0.0


def open_files(paths: list[Path]) -> MotionFile:
    """One file of any kind, or several of one frame each.

    Raises:
        LiveHandError: as the backend's readers.
    """
    return open_motion_file(paths[0]) if len(paths) == 1 else open_pose_files(paths)


def changed(file: MotionFile, changes: Changes) -> MotionFile:
    """The file as the user reads it.

    Raises:
        LiveHandError: a change that cannot be.
    """
    if isinstance(file, LandmarkFile):
        kept = {key: value for key, value in changes.fields.items() if key not in ("has_mean_added", "pca_components")}
        return file.turned_round(is_picture_mirrored=changes.is_picture_mirrored, **kept)
    return file.turned_round(**changes.fields)


def motion_from(
    file: MotionFile, changes: Changes, model: HandModel, model_path: Path | None
) -> tuple[HandMotion, str | None]:
    """The motion of a changed file, and what speaks against the reading.

    Args:
        file: as `changed` gave it.
        changes: the user's.
        model: of the hand that takes the motion.
        model_path: where that came from; None: it is the built-in one.

    Raises:
        LiveHandError: MANO's file is needed and missing, or landmarks are no hand's.
    """
    if isinstance(file, LandmarkFile):
        return file.motion(model, changes.smooth_frames), file.doubt(model)
    basis = basis_for(changes.mano_path, model_path)
    return file.motion(basis), file.doubt(basis)
