"""The motion of one hand: every pose file is read into one, and LiveHand's own files store one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from ..records.errors import LiveHandError
from ..records.shot import HandPose
from ..records.side import Side

MOST_FRAMES = 300_000
"""Of a motion; more than an hour at 60 frames per second."""
FPS_RANGE = (0.01, 100_000.0)


@dataclass(frozen=True)
class HandMotion:
    """T poses of one hand at equal time steps.

    Attributes:
        theta: [T, 16, 3] axis-angle per joint, rad, with MANO's mean pose already added. Joint 0 is the wrist.
        beta: [10] shape, or [T, 10].
        transl: [T, 3] m.
        fps: frames per second; None if unknown.
        side: which hand.
        forearm: [3] axis-angle, rad, of the forearm against the hand as `HandPose` has it, or [T, 3]; zeros: straight.

    Raises:
        LiveHandError: there is no frame or are too many, shapes disagree, a number is not finite, or the rate is not
            a film's.
    """

    theta: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    fps: float | None = None
    side: Side = "right"
    forearm: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        count = len(self.theta) if np.ndim(self.theta) else 0
        if not 0 < count <= MOST_FRAMES:
            got = count or "none"
            raise LiveHandError(f"a motion must have at least one frame and at most {MOST_FRAMES}, got {got}")
        shapes = {
            "theta": ((count, 16, 3),),
            "beta": ((10,), (count, 10)),
            "transl": ((count, 3),),
            "forearm": ((3,), (count, 3)),
        }
        for name, allowed in shapes.items():
            value = np.asarray(getattr(self, name))
            if value.shape not in allowed:
                wanted = " or ".join(str(list(shape)) for shape in allowed)
                raise LiveHandError(f"{name} of {count} frames must be {wanted}, got {list(value.shape)}")
            if not np.isfinite(value).all():
                raise LiveHandError(
                    f"{name} must be finite, got NaN or infinity {_non_finite_frames(value, count)}; repair the file"
                )
        if self.fps is not None and not FPS_RANGE[0] <= self.fps <= FPS_RANGE[1]:
            raise LiveHandError(
                f"fps must be a positive number, from {FPS_RANGE[0]:g} to {FPS_RANGE[1]:g}, got {self.fps}"
            )

    def __len__(self) -> int:
        return len(self.theta)

    @property
    def betas(self) -> np.ndarray:
        """[T, 10], also where the shape is constant."""
        return np.broadcast_to(self.beta, (len(self), 10))

    @property
    def forearms(self) -> np.ndarray:
        """[T, 3], also where the forearm does not turn."""
        return np.broadcast_to(self.forearm, (len(self), 3))

    def pose(self, index: int) -> HandPose:
        """Return the pose of one frame."""
        beta, forearm = self.betas[index].copy(), self.forearms[index].copy()
        return HandPose(self.theta[index], beta, self.transl[index], self.side, forearm)


def motion_from_poses(poses: Sequence[HandPose], fps: float | None = None) -> HandMotion:
    """Join poses of one side to a motion; beta is [10] and forearm [3] if all poses share it."""
    beta, forearm = (shared(np.array([getattr(pose, name) for pose in poses])) for name in ("beta", "forearm"))
    theta, transl = np.array([pose.theta for pose in poses]), np.array([pose.transl for pose in poses])
    sides: set[Side] = {pose.side for pose in poses}
    if len(sides) > 1:
        raise LiveHandError("a motion must be of one hand, got right and left poses; write two files")
    return HandMotion(theta, beta, transl, fps, sides.pop() if sides else "right", forearm)


def shared(values: np.ndarray) -> np.ndarray:
    """Reduce values [T, n] to one row [n] if all are equal, else return them."""
    return values[0] if len(values) and (values == values[0]).all() else values


def mirrored(motion: HandMotion) -> HandMotion:
    """Mirror the motion for the other hand, at the plane x = 0 of the hand's own space."""
    side: Side = "left" if motion.side == "right" else "right"
    theta, forearm = motion.theta * MIRROR_AXIS_ANGLE, motion.forearm * MIRROR_AXIS_ANGLE
    return replace(motion, theta=theta, transl=motion.transl * MIRROR_POINT, side=side, forearm=forearm)


def _non_finite_frames(value: np.ndarray, count: int) -> str:
    if len(value) != count or value.ndim < 2:
        return "in it"
    rows = np.flatnonzero(~np.isfinite(value.reshape(count, -1)).all(1))
    return f"in {len(rows)} of {count} frames, the first at index {rows[0]}"
