"""Poses and the one shape of both hands, by the landmarks of all views.

First a fit to triangulated landmarks, hand by hand; then all pictures' landmarks at once, robustly. What a tracker
takes for a joint lies beside the model's, by 2 to 3 mm and alike in all views: each landmark has an offset of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...hand.model import HandModel
from ...motion.landmarks.fit import LandmarkNoise, fit_landmarks
from ...records.camera import Camera
from ...records.shot import HandPose
from ...records.side import Side
from .association import AssociatedHand
from .rig_cameras import RigCameras
from .rig_hands import HandParameters, RigHands

_TRIANGULATED = LandmarkNoise(0.003, fits_scale=False)
_STEPS = 250
_RATES = (0.01, 0.03, 0.001, 0.0005)  # of theta, beta, transl and the landmarks' offsets
_LANDMARK_MM = 5.0  # scale of the robust residual
_OFFSET_MM = 2.5  # standard deviation of a landmark from the model's joint
_THETA_WEIGHT, _BETA_WEIGHT = 8.0, 0.2


class LandmarkPoses(NamedTuple):
    """Poses by side with one beta, and the offsets of the landmarks from the model's joints, [21, 3] m of each."""

    poses: dict[Side, HandPose]
    offsets: dict[Side, np.ndarray]


class LandmarkTargets(NamedTuple):
    """Where one view shows one hand's landmarks: rows of hand and view, px [21, 2], and px in a millimetre."""

    hand: int
    view: int
    px: Tensor
    px_per_mm: float

    def off_mm(self, cameras: RigCameras, landmarks: Tensor, turns: Tensor) -> Tensor:
        """Measure how far landmarks [S, 21, 3] m are projected off, [21] mm at the hand."""
        px = cameras.project(landmarks[self.hand], self.view, turns[self.view])[0]
        return (px - self.px).norm(dim=-1) / self.px_per_mm


def landmark_targets(hands: Sequence[AssociatedHand], cameras: RigCameras) -> list[LandmarkTargets]:
    """List what all views show of all hands."""
    targets = []
    for row, hand in enumerate(hands):
        points = torch.as_tensor(hand.points, dtype=torch.float32)
        for find in hand.finds:
            px = torch.as_tensor(find.px, dtype=torch.float32)
            targets.append(LandmarkTargets(row, find.view, px, cameras.px_per_m(find.view, points) / 1000))
    return targets


def landmark_poses(
    hands: Sequence[AssociatedHand], cameras: Sequence[Camera], points: np.ndarray, model: HandModel
) -> LandmarkPoses:
    """Fit poses and the one shape.

    Args:
        hands: of S sides, with finds in these cameras.
        cameras: calibrated.
        points: [S, 21, 3] m, the triangulated landmarks.
        model: the hand.
    """
    start = {hand.side: _of_points(points[row], model, hand.side) for row, hand in enumerate(hands)}
    sides = tuple(start)
    rig, stacked = RigHands.of(model, sides), RigCameras.of(cameras)
    targets, first = landmark_targets(hands, stacked), rig.parameters(start)
    still = torch.zeros(len(cameras), 3)
    theta, beta, transl = (values.clone().requires_grad_() for values in first[:3])
    offsets = torch.zeros(len(sides), 21, 3, requires_grad=True)
    groups = [{"params": [p], "lr": rate} for p, rate in zip((theta, beta, transl, offsets), _RATES, strict=True)]
    optimizer = torch.optim.Adam(groups)
    for _ in range(_STEPS):
        landmarks = rig.show(HandParameters(theta, beta, transl, first.forearm)).landmarks + offsets
        off = torch.cat([target.off_mm(stacked, landmarks, still) for target in targets]) / _LANDMARK_MM
        loss = 36 * ((1 + off**2).sqrt() - 1).mean() * len(sides)
        loss = loss + _THETA_WEIGHT * ((theta - first.theta)[:, 1:] ** 2).sum() + _BETA_WEIGHT * (beta**2).sum()
        loss = loss + 4 * len(sides) * (offsets * 1000 / _OFFSET_MM).pow(2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    poses = rig.poses(HandParameters(theta, beta, transl, first.forearm))
    return LandmarkPoses(poses, {side: offsets[row].detach().numpy() for row, side in enumerate(sides)})


def _of_points(points: np.ndarray, model: HandModel, side: Side) -> HandPose:
    motion = fit_landmarks(points[None], model, side, noise=_TRIANGULATED).motion
    return HandPose(motion.theta[0], np.reshape(motion.betas, (-1, 10))[0], motion.transl[0], side)
