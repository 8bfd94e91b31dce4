"""Poses and the one shape of both hands, by the landmarks of all views.

First a fit to triangulated landmarks, hand by hand; then all pictures' landmarks at once, robustly. What a tracker
takes for a joint lies beside the model's, by 2 to 3 mm and alike in all views: each landmark has an offset of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
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
    """Where views show hands' landmarks.

    Attributes:
        hand: [O] row of the hand.
        view: [O] row of the view.
        px: [O, 21, 2].
        px_per_mm: [O] px in a millimetre at the hand.
    """

    hand: Tensor
    view: Tensor
    px: Tensor
    px_per_mm: Tensor

    def off_mm(self, cameras: RigCameras, landmarks: Tensor, turns: Tensor) -> Float[Tensor, "O 21"]:
        """Measure how far landmarks [S, 21, 3] m are projected off, mm at the hand, by cameras turned by [C, 3] rad."""
        px = cameras.project_by_views(landmarks[self.hand], self.view, turns)
        return (px - self.px).norm(dim=-1) / self.px_per_mm[:, None]

    def in_views(self, rows: Collection[int]) -> LandmarkTargets:
        """Choose the targets of these views."""
        chosen = torch.isin(self.view, torch.as_tensor(sorted(rows), dtype=torch.long))
        return LandmarkTargets(*(values[chosen] for values in self))


def landmark_targets(hands: Sequence[AssociatedHand], cameras: RigCameras) -> LandmarkTargets:
    """Stack what all views show of all hands."""
    pairs = [(row, find) for row, hand in enumerate(hands) for find in hand.finds]
    points = [torch.as_tensor(hand.points, dtype=torch.float32) for hand in hands]
    return LandmarkTargets(
        hand=torch.tensor([row for row, _ in pairs]),
        view=torch.tensor([find.view for _, find in pairs]),
        px=torch.as_tensor(np.stack([find.px for _, find in pairs]), dtype=torch.float32),
        px_per_mm=torch.tensor([cameras.px_per_m(find.view, points[row]) / 1000 for row, find in pairs]),
    )


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
    start: dict[Side, HandPose] = {
        hand.side: _of_points(points[row], model, hand.side) for row, hand in enumerate(hands)
    }
    sides = tuple(start)
    rig, stacked = RigHands.of(model, sides).of_landmarks_alone(), RigCameras.of(cameras)
    targets, first = landmark_targets(hands, stacked), rig.parameters(start)
    still = torch.zeros(len(cameras), 3)
    theta, beta, transl = (values.clone().requires_grad_() for values in first[:3])
    offsets = torch.zeros(len(sides), 21, 3, requires_grad=True)
    groups = [{"params": [p], "lr": rate} for p, rate in zip((theta, beta, transl, offsets), _RATES, strict=True)]
    optimizer = torch.optim.Adam(groups)
    for _ in range(_STEPS):
        landmarks = rig.show(HandParameters(theta, beta, transl, first.forearm)).landmarks + offsets
        off = targets.off_mm(stacked, landmarks, still) / _LANDMARK_MM
        loss = 36 * ((1 + off**2).sqrt() - 1).mean() * len(sides)
        loss = loss + _THETA_WEIGHT * ((theta - first.theta)[:, 1:] ** 2).sum() + _BETA_WEIGHT * (beta**2).sum()
        loss = loss + 4 * len(sides) * (offsets * 1000 / _OFFSET_MM).pow(2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    poses = rig.poses(HandParameters(theta, beta, transl, first.forearm))
    by_side: dict[Side, np.ndarray] = {side: offsets[row].detach().numpy() for row, side in enumerate(sides)}
    return LandmarkPoses(poses, by_side)


def _of_points(points: np.ndarray, model: HandModel, side: Side) -> HandPose:
    motion = fit_landmarks(points[None], model, side, noise=_TRIANGULATED).motion
    return HandPose(motion.theta[0], np.reshape(motion.betas, (-1, 10))[0], motion.transl[0], side)
