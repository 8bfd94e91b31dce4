"""Poses with errors of a known size, and the distance of poses from the true ones: to measure pose refinement."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import degrees, radians, sqrt
from typing import NamedTuple

import numpy as np

from ..capture.capture import Capture
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..records.shot import HandPose


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
