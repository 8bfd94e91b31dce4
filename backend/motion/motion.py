"""A hand in motion: what every pose file becomes, and what ours holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from ..records.errors import LiveHandError
from ..records.shot import HandPose, Side


@dataclass(frozen=True)
class HandMotion:
    """T poses of one hand, evenly in time.

    Attributes:
        theta: [T, 16, 3] axis-angle per joint, rad, absolute: the mean is in it. Joint 0 turns about the wrist.
        beta: [10] shape, or [T, 10].
        transl: [T, 3] m.
        fps: frames per second; None where nobody knows.
        side: which hand.

    Raises:
        LiveHandError: no frame, shapes that disagree, a number that is not finite, or a rate that is not positive.
    """

    theta: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    fps: float | None = None
    side: Side = "right"

    def __post_init__(self):
        count = len(self.theta) if np.ndim(self.theta) else 0
        if count == 0:
            raise LiveHandError("a motion must have at least one frame, got none")
        shapes = {"theta": ((count, 16, 3),), "beta": ((10,), (count, 10)), "transl": ((count, 3),)}
        for name, allowed in shapes.items():
            value = np.asarray(getattr(self, name))
            if value.shape not in allowed:
                wanted = " or ".join(str(list(shape)) for shape in allowed)
                raise LiveHandError(f"{name} of {count} frames must be {wanted}, got {list(value.shape)}")
            if not np.isfinite(value).all():
                raise LiveHandError(
                    f"{name} must be finite, got NaN or infinity {_where(value, count)}; repair the file"
                )
        if self.fps is not None and not (np.isfinite(self.fps) and self.fps > 0):
            raise LiveHandError(f"fps must be a positive number, got {self.fps}")

    def __len__(self) -> int:
        return len(self.theta)

    @property
    def betas(self) -> np.ndarray:
        """[T, 10], whether the shape changes or not."""
        return np.broadcast_to(self.beta, (len(self), 10))

    def pose(self, index: int) -> HandPose:
        """One frame."""
        return HandPose(self.theta[index], self.betas[index].copy(), self.transl[index], self.side)


def motion_of(poses: Sequence[HandPose], fps: float | None = None) -> HandMotion:
    """Poses of one side, in order, as a motion; one shape where they share it."""
    betas = np.array([pose.beta for pose in poses])
    beta = betas[0] if len(betas) and (betas == betas[0]).all() else betas
    theta, transl = np.array([pose.theta for pose in poses]), np.array([pose.transl for pose in poses])
    sides: set[Side] = {pose.side for pose in poses}
    if len(sides) > 1:
        raise LiveHandError("a motion must be of one hand, got poses of a right and of a left one; write two files")
    return HandMotion(theta, beta, transl, fps, sides.pop() if sides else "right")


def mirrored(motion: HandMotion) -> HandMotion:
    """The other hand doing the same, seen in the mirror x = 0 of the hand's own space."""
    side: Side = "left" if motion.side == "right" else "right"
    return replace(motion, theta=motion.theta * MIRROR_AXIS_ANGLE, transl=motion.transl * MIRROR_POINT, side=side)


def _where(value: np.ndarray, count: int) -> str:
    if len(value) != count or value.ndim < 2:
        return "in it"
    rows = np.flatnonzero(~np.isfinite(value.reshape(count, -1)).all(1))
    return f"in {len(rows)} of {count} frames, the first at index {rows[0]}"
