"""Captures whose meshes do not fit: noisy landmarks, another shape, a smoother template (paper section 4.3).

A tracker is imitated: each pose's 21 landmarks get normal noise, and the hand model is fitted to them again. In the arm
`training` only the training poses are noisy; in `tracking`, the held-out ones too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians, sqrt
from typing import NamedTuple

import numpy as np

from ...capture.capture import Capture
from ...geometry.mesh_tables import neighbour_table
from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...motion.landmarks.fit import LandmarkNoise, fit_landmarks
from ...motion.landmarks.skeleton import landmarks_of
from ...records.shot import HandPose


class PoseError(NamedTuple):
    """Root mean squares over poses of the errors of joint angles (axis-angle), translations, and vertices."""

    theta_deg: float
    transl_mm: float
    vertex_mm: float


def with_noise(capture: Capture, theta_deg: float, transl_mm: float, seed: int) -> Capture:
    """Add Gaussian errors to the capture's training poses; held-out poses are not changed.

    Args:
        capture: with true poses.
        theta_deg: root mean square length of the axis-angle error of each joint.
        transl_mm: root mean square length of the error of each translation.
        seed: of the errors.
    """
    random = np.random.default_rng(seed)
    trained = {view.pose_index for view in capture.of_split("train")}
    poses = [
        _moved(pose, radians(theta_deg), transl_mm / 1000, random) if index in trained else pose
        for index, pose in enumerate(capture.poses)
    ]
    return replace(capture, poses=tuple(poses))


def pose_error(
    poses: tuple[HandPose, ...], truth: tuple[HandPose, ...], indices: Iterable[int], hand: HandModel
) -> PoseError:
    """Measure how far the poses of these indices are from the true ones, without the error that all of them share.

    The mean error of angles and translations is removed: training compensates it in the avatar's networks, and
    `Refinement` does not correct it.
    """
    pairs = [(poses[index], truth[index]) for index in indices]
    theta, transl = (np.stack([getattr(a, name) - getattr(b, name) for a, b in pairs]) for name in ("theta", "transl"))
    mean_theta, mean_transl = theta.mean(0), transl.mean(0)
    centred = [replace(a, theta=a.theta - mean_theta, transl=a.transl - mean_transl) for a, _ in pairs]
    vertices = np.stack(
        [posed_vertices(hand, a) - posed_vertices(hand, b) for a, (_, b) in zip(centred, pairs, strict=True)]
    )
    return PoseError(
        theta_deg=degrees(_rms(theta - mean_theta)),
        transl_mm=1000 * _rms(transl - mean_transl),
        vertex_mm=1000 * _rms(vertices),
    )


def _moved(pose: HandPose, angle_rad: float, distance_m: float, random: np.random.Generator) -> HandPose:
    theta = pose.theta + random.normal(0, angle_rad / sqrt(3), (16, 3))
    return replace(pose, theta=theta, transl=pose.transl + random.normal(0, distance_m / sqrt(3), 3))


def _rms(vectors: np.ndarray) -> float:
    """Compute the root mean square length of vectors."""
    return float(np.sqrt((vectors**2).sum(-1).mean()))


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
