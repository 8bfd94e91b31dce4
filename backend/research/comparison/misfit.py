"""Captures whose meshes do not fit: noisy landmarks, another shape, a smoother template (paper section 4.3).

A tracker is imitated: each pose's 21 landmarks get normal noise, and the hand model is fitted to them again. In the arm
`training` only the training poses are noisy; in `tracking`, the held-out ones too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...capture.capture import Capture
from ...geometry.mesh_tables import neighbour_table
from ...hand.model import HandModel
from ...motion.landmarks.fit import LandmarkNoise, fit_landmarks
from ...motion.landmarks.skeleton import landmarks_of
from ...records.shot import HandPose
from ...training.pose_noise import pose_error

SIGMAS_MM = (0.0, 0.5, 1.0, 2.0, 4.0)
SHAPES = ("beta", "smooth")
"""Beta drawn from N(0, 1); the template after five Laplacian steps."""
ROWS = ("mesh_wrapping", "smplpix", "paper", "default", "default_refined")
_LEAST_DEVIATION_M = 0.0005
_SMOOTHING_STEPS = 5


class Misfitting(NamedTuple):
    """What a level of misfit is trained and measured on.

    Attributes:
        training: the capture to fit to.
        arms: the captures to measure on, by name.
        hand: the model that the method is given.
        vertex_mm: root mean square error of the training meshes' vertices.
    """

    training: Capture
    arms: dict[str, Capture]
    hand: HandModel
    vertex_mm: float


@dataclass(frozen=True)
class Misfit:
    """One level: noise on landmarks in mm along each axis, or one of `SHAPES`."""

    level: float | str

    @property
    def name(self) -> str:
        """In folders and tables."""
        return self.level if isinstance(self.level, str) else f"{self.level:g}mm"

    def of(self, capture: Capture, hand: HandModel, seed: int) -> Misfitting:
        """Make the captures of this level, of a capture whose poses are true."""
        if self.level == "smooth":
            smooth = smoothed(hand)
            off = np.sqrt(((smooth.v_template - hand.v_template) ** 2).sum(1).mean())
            same = _named(capture, self.name, seed)
            return Misfitting(same, {"tracking": same}, smooth, 1000 * float(off))
        trained = sorted({view.pose_index for view in capture.of_split("train")})
        if self.level == "beta":
            beta = np.random.default_rng(seed).normal(size=10)
            noisy = tuple(replace(pose, beta=pose.beta + beta) for pose in capture.poses)
        else:
            noisy = noisy_poses(capture.poses, hand, float(self.level), seed)
        every = replace(_named(capture, self.name, seed), poses=noisy)
        some = tuple(noisy[k] if k in trained else pose for k, pose in enumerate(capture.poses))
        training = replace(every, poses=some)
        error = pose_error(noisy, capture.poses, trained, hand).vertex_mm
        return Misfitting(training, {"training": training, "tracking": every}, hand, error)


def noisy_poses(poses: Sequence[HandPose], hand: HandModel, sigma_mm: float, seed: int) -> tuple[HandPose, ...]:
    """Fit the poses again to their landmarks with normal noise; shape stays. Without noise the fit is not exact."""
    random = np.random.default_rng(seed)
    noise = LandmarkNoise(max(sigma_mm / 1000, _LEAST_DEVIATION_M), fits_scale=False)
    return tuple(_refitted(pose, hand, sigma_mm / 1000, noise, random) for pose in poses)


def _refitted(
    pose: HandPose, hand: HandModel, sigma_m: float, noise: LandmarkNoise, random: np.random.Generator
) -> HandPose:
    points = landmarks_of(hand, pose)
    points = points + random.normal(0, sigma_m, points.shape) if sigma_m else points
    motion = fit_landmarks(points[None], hand, pose.side, noise=noise).motion
    wrist = _wrist(hand, pose, motion.betas[0]) - _wrist(hand, pose, pose.beta)
    return replace(pose, theta=motion.theta[0], transl=motion.transl[0] + wrist)


def _wrist(hand: HandModel, pose: HandPose, beta: np.ndarray) -> np.ndarray:
    """Return the rest wrist [3] of a shape."""
    model = hand.for_side(pose.side)
    return model.J_regressor[0] @ (model.v_template + model.shapedirs @ beta)


def smoothed(hand: HandModel, steps: int = _SMOOTHING_STEPS) -> HandModel:
    """Move each vertex to its neighbours' mean, so many times; the hand keeps its identity."""
    vertices, neighbours = hand.v_template, neighbour_table(hand.f, len(hand.v_template))
    is_other = neighbours != np.arange(len(vertices))[:, None]
    for _ in range(steps):
        summed = (vertices[neighbours] * is_other[..., None]).sum(1)
        vertices = summed / is_other.sum(1, keepdims=True)
    return replace(hand, v_template=vertices)


def _named(capture: Capture, name: str, seed: int) -> Capture:
    return replace(capture, provenance={**capture.provenance, "misfit": name, "misfit_seed": seed})
