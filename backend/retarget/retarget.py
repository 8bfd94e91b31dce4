"""Another rig's motion as theta and transl of our hand: where their bones point, ours do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.rotation import matrix_to_axis_angle
from ..hand.model import PARENTS
from ..motion.motion import HandMotion
from ..motion.spaces import rest_wrists
from ..records.errors import LiveHandError
from ..records.shot import Side
from .rest_alignment import Alignment


@dataclass(frozen=True)
class SourceMotion:
    """T poses of the 16 mapped bones of another rig in the world.

    Attributes:
        frames: [T, 16, 3, 3] rotations, columns a bone's X, Y and Z; as `RestSkeleton.frames`, posed.
        wrists: [T, 3] m, where the wrist's bone begins.
        fps: frames per second, None where nobody knows.
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


def retarget(source: SourceMotion, alignment: Alignment) -> HandMotion:
    """Our hand's motion in Blender's world, of the shape that the alignment has; its scale is left to the object."""
    turned = source.frames @ alignment.frames.swapaxes(1, 2)  # since rest, in the world
    whole = turned @ alignment.turns
    above = np.concatenate([np.tile(np.eye(3), (len(whole), 1, 1, 1)), whole[:, list(PARENTS[1:])]], 1)
    theta = matrix_to_axis_angle(above.swapaxes(2, 3) @ whole)
    wrists = source.wrists + turned[:, 0] @ (alignment.wrist - alignment.heads[0])
    beta = alignment.shape.beta
    return HandMotion(theta, beta, wrists - rest_wrists(alignment.model, beta), source.fps, source.side)
