"""How far poses lie from true ones: what trackers and fits are measured by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ..hand.model import HandModel
from ..motion.landmarks.skeleton import landmarks_of
from ..records.shot import HandPose

_TIPS = [4, 8, 12, 16, 20]  # in MediaPipe's order


class PoseErrors(NamedTuple):
    """Means over poses.

    Attributes:
        fingers_deg: between the rotations of the 15 joints of the fingers.
        wrist_deg: between those of the wrist.
        tips_mm: of the fingertips, seen from the wrist.
    """

    fingers_deg: float
    wrist_deg: float
    tips_mm: float

    def __str__(self) -> str:
        return f"fingers {self.fingers_deg:.2f} deg, wrist {self.wrist_deg:.2f} deg, tips {self.tips_mm:.1f} mm"


def pose_errors(model: HandModel, poses: Sequence[HandPose], true: Sequence[HandPose]) -> PoseErrors:
    """Measure poses of a hand, each of its own shape, against as many true ones, in the same axes."""
    ours, theirs = (axis_angle_to_matrix(np.stack([pose.theta for pose in some])) for some in (poses, true))
    off_deg = np.rad2deg(np.linalg.norm(matrix_to_axis_angle(ours.swapaxes(-1, -2) @ theirs), axis=-1))
    points, wanted = (np.stack([landmarks_of(model, pose) for pose in some]) for some in (poses, true))
    tips_m = ((points - points[:, :1]) - (wanted - wanted[:, :1]))[:, _TIPS]
    off_m = np.linalg.norm(tips_m, axis=-1)
    return PoseErrors(float(off_deg[:, 1:].mean()), float(off_deg[:, 0].mean()), 1000 * float(off_m.mean()))
