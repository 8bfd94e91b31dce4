"""Retargets another rig's motion to theta and transl of a hand model: its bones point where the rig's do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.rotation import matrix_to_axis_angle
from ..hand.model import PARENTS
from ..motion.motion import HandMotion
from ..motion.spaces import rest_wrists
from ..records.errors import LiveHandError
from ..records.side import Side
from .rest_alignment import RestAlignment


@dataclass(frozen=True)
class SourceMotion:
    """T poses of the 16 mapped bones of another rig, in the world.

    Attributes:
        frames: [T, 16, 3, 3] posed `SourceSkeleton.frames`: rotations whose columns are a bone's X, Y and Z.
        wrists: [T, 3] m, heads of the wrist's bone.
        fps: frames per second; None if unknown.
        side: which hand.

    Raises:
        LiveHandError: shapes disagree, or a number is not finite.
    """

    frames: np.ndarray
    wrists: np.ndarray
    fps: float | None
    side: Side

    def __post_init__(self):
        count = len(self.wrists)
        if self.frames.shape != (count, 16, 3, 3) or self.wrists.shape != (count, 3):
            raise LiveHandError(
                f"frames must be [T, 16, 3, 3] and wrists [T, 3], got {list(self.frames.shape)} and "
                f"{list(self.wrists.shape)}"
            )
        if not (np.isfinite(self.frames).all() and np.isfinite(self.wrists).all()):
            raise LiveHandError("the other rig's pose must be finite, got NaN or infinity; repair its animation")


def retarget(source: SourceMotion, alignment: RestAlignment) -> HandMotion:
    """The motion in Blender's world of a hand of the alignment's shape; the object carries the shape's scale."""
    since_rest = source.frames @ alignment.frames.swapaxes(1, 2)  # rotations in the world
    rotations = since_rest @ alignment.rotations
    parents = np.concatenate([np.tile(np.eye(3), (len(rotations), 1, 1, 1)), rotations[:, list(PARENTS[1:])]], 1)
    theta = matrix_to_axis_angle(parents.swapaxes(2, 3) @ rotations)
    wrists = source.wrists + since_rest[:, 0] @ (alignment.wrist - alignment.heads[0])
    beta = alignment.shape.beta
    return HandMotion(theta, beta, wrists - rest_wrists(alignment.model, beta), source.fps, source.side)
