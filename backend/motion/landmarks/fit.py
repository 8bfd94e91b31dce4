"""Landmarks to poses: a hand model bent until its joints and fingertips lie on them.

Maximum a posteriori: landmarks with a normal error, free angles with the distribution of natural poses and hard limits,
one shape for all frames. Poses by Gauss-Newton with Levenberg's damping, all frames at once; the shape, in which
landmarks are linear, between them by least squares. A scale that is not to be trusted is taken out first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...hand.model import MIRROR_POINT, HandModel
from ...records.errors import LiveHandError
from ...records.shot import SIDES, Side
from ..motion import HandMotion, mirrored
from .articulation import FREE, NaturalPoses, all_angles, within_limits
from .initial_pose import aligned_bones, aligned_palm
from .skeleton import NODES_OF_LANDMARKS, Posed, Skeleton, derivative_of_nodes

_ROUNDS = 4  # of poses and shape
_STEPS = 6  # of the poses in each
_FRAMES_AT_ONCE = 500  # bounds memory
_FRAMES_TO_TELL = 40  # which hand it is
_SCALES = (0.4, 2.5)
_COLUMNS = np.concatenate([np.arange(6), 6 + FREE])


class Trust(NamedTuple):
    """How far landmarks are to be trusted.

    Attributes:
        deviation_m: how far they lie from the model's own joints and fingertips, along each axis.
        fits_scale: their scale is a guess.
    """

    deviation_m: float
    fits_scale: bool


METRIC = Trust(0.004, fits_scale=False)
"""Of a tracker that measures."""
GUESSED = Trust(0.008, fits_scale=True)
"""Of one that guesses depth and size from a picture, as MediaPipe does, and whose joints are not a hand model's."""


@dataclass(frozen=True)
class LandmarkFit:
    """What came out.

    Attributes:
        motion: in the landmarks' own space, m; transl brings the model's wrist to the landmarks'.
        scale: by which the landmarks were larger than the hand; the motion is without it, about each frame's centre.
        rms_m: root mean square distance of landmarks and model.
    """

    motion: HandMotion
    scale: float
    rms_m: float


class _Poses(NamedTuple):
    """T poses: root [T, 3, 3], wrist [T, 3] m, free angles [T, 21]."""

    root: np.ndarray
    wrist: np.ndarray
    free: np.ndarray


def fit_landmarks(
    points: np.ndarray, model: HandModel, side: Side, fps: float | None = None, trust: Trust = GUESSED
) -> LandmarkFit:
    """The motion of a hand model that lies nearest to landmarks.

    Args:
        points: [T, 21, 3] m, in MediaPipe's order, of a hand of `side`.
        model: any hand in MANO's format.
        side: which hand the landmarks are of; the motion is of it.
        fps: of the landmarks.
        trust: in the landmarks, against natural poses and the model's own size.

    Raises:
        LiveHandError: no frames, not finite, another shape, or not of a hand's size in metres.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 3 or points.shape[1:] != (21, 3) or len(points) == 0 or not np.isfinite(points).all():
        raise LiveHandError(
            f"landmarks must be finite and [T, 21, 3] m, got {list(points.shape)}; track the take again"
        )
    nodes = np.empty_like(points)
    nodes[:, NODES_OF_LANDMARKS] = points if side == "right" else points * MIRROR_POINT
    skeleton = Skeleton.of(model)
    scale, beta, natural = _scale(nodes, skeleton), np.zeros(10), NaturalPoses.of_gestures()
    if not trust.fits_scale:
        scale = 1.0
    nodes = _true_to(scale, nodes)
    poses = _guess(nodes, skeleton, beta)
    for _ in range(_ROUNDS):
        poses = _improved(poses, nodes, skeleton, beta, natural, trust)
        beta = _shape(poses, nodes, skeleton, trust)
    poses = _improved(poses, nodes, skeleton, beta, natural, trust)
    return _result(poses, nodes, skeleton, beta, scale, side, fps)


def likelier_side(points: np.ndarray, model: HandModel) -> Side:
    """Which hand landmarks [T, 21, 3] m are of, by which bends naturally: of at most 40 frames."""
    some = points[:: max(1, len(points) // _FRAMES_TO_TELL)]
    right, left = (fit_landmarks(some, model, side).rms_m for side in SIDES)
    return "right" if right <= left else "left"


def _scale(nodes: np.ndarray, skeleton: Skeleton) -> float:
    """Of the palm's bones, which no pose changes; what is left of it, the shape takes."""
    seen = np.linalg.norm(nodes[:, [1, 5, 9, 13]] - nodes[:, :1], axis=-1).mean()
    scale = float(seen / np.linalg.norm(skeleton.offsets(np.zeros(10))[:4, 0], axis=-1).mean())
    if not _SCALES[0] < scale < _SCALES[1]:
        raise LiveHandError(
            f"landmarks must be a hand's, in metres, got one {scale:.3g} times as large; "
            "give world landmarks, not those in the picture"
        )
    return scale


def _true_to(scale: float, nodes: np.ndarray) -> np.ndarray:
    """Nodes [T, 21, 3] without the scale; each frame's centre stays where it is."""
    centre = nodes.mean(1, keepdims=True)
    return centre + (nodes - centre) / scale


def _guess(nodes: np.ndarray, skeleton: Skeleton, beta: np.ndarray) -> _Poses:
    root, wrist = aligned_palm(nodes, skeleton.rest + skeleton.shape @ beta)
    return _Poses(root, wrist, within_limits(aligned_bones(nodes, root, skeleton, beta)))


def _improved(
    poses: _Poses, nodes: np.ndarray, skeleton: Skeleton, beta: np.ndarray, natural: NaturalPoses, trust: Trust
) -> _Poses:
    """A few damped Gauss-Newton steps; a frame whose step makes it worse stays, and tries a shorter one next time."""
    parts = []
    for first in range(0, len(nodes), _FRAMES_AT_ONCE):
        some = slice(first, first + _FRAMES_AT_ONCE)
        problem = _Problem(nodes[some], skeleton, skeleton.offsets(beta), natural, trust.deviation_m)
        parts.append(problem.solve(_Poses(*(part[some] for part in poses))))
    return _Poses(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _Problem:
    """Poses of one shape: nodes [T, 21, 3] m to reach."""

    nodes: np.ndarray
    skeleton: Skeleton
    offsets: np.ndarray
    natural: NaturalPoses
    deviation_m: float

    def solve(self, poses: _Poses) -> _Poses:
        posed = self._posed(poses)
        cost, damping = self._cost(poses, posed), np.full(len(self.nodes), 1e-2)
        for _ in range(_STEPS):
            tried = self._stepped(poses, posed, damping)
            tried_posed = self._posed(tried)
            tried_cost = self._cost(tried, tried_posed)
            is_better = tried_cost <= cost
            poses = _Poses(*(_chosen(is_better, new, old) for new, old in zip(tried, poses, strict=True)))
            posed = Posed(*(_chosen(is_better, new, old) for new, old in zip(tried_posed, posed, strict=True)))
            cost, damping = np.where(is_better, tried_cost, cost), np.where(is_better, damping / 5, damping * 10)
        return poses

    def _stepped(self, poses: _Poses, posed: Posed, damping: np.ndarray) -> _Poses:
        slopes = derivative_of_nodes(posed)[..., _COLUMNS].reshape(len(self.nodes), 63, len(_COLUMNS))
        missing = (self.nodes - posed.nodes).reshape(len(self.nodes), 63, 1)
        matrix = slopes.swapaxes(1, 2) @ slopes / self.deviation_m**2
        right = (slopes.swapaxes(1, 2) @ missing)[..., 0] / self.deviation_m**2
        matrix[:, 6:, 6:] += self.natural.precision
        right[:, 6:] -= (poses.free - self.natural.mean) @ self.natural.precision
        diagonal = np.einsum("tkk->tk", matrix)
        diagonal += damping[:, None] * diagonal
        step = np.linalg.solve(matrix, right[..., None])[..., 0]
        root = axis_angle_to_matrix(step[:, :3]) @ poses.root
        return _Poses(root, poses.wrist + step[:, 3:6], within_limits(poses.free + step[:, 6:]))

    def _posed(self, poses: _Poses) -> Posed:
        return self.skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), self.offsets)

    def _cost(self, poses: _Poses, posed: Posed) -> np.ndarray:
        """[T]."""
        apart = ((self.nodes - posed.nodes) ** 2).sum((1, 2)) / self.deviation_m**2
        off = poses.free - self.natural.mean
        return apart + ((off @ self.natural.precision) * off).sum(-1)


def _shape(poses: _Poses, nodes: np.ndarray, skeleton: Skeleton, trust: Trust) -> np.ndarray:
    """[10] beta of all frames: nodes, less each frame's mean, are linear in it; a deviation of 1 is expected."""
    posed = skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), skeleton.offsets(np.zeros(10)))
    rest, slopes = skeleton.shape_terms(posed.turned)
    rest, slopes, seen = (values - values.mean(1, keepdims=True) for values in (rest, slopes, nodes))
    columns = slopes.reshape(-1, 10) / trust.deviation_m
    missing = (seen - rest).reshape(-1) / trust.deviation_m
    return np.linalg.solve(columns.T @ columns + np.eye(10), columns.T @ missing)


def _result(
    poses: _Poses, nodes: np.ndarray, skeleton: Skeleton, beta: np.ndarray, scale: float, side: Side, fps: float | None
) -> LandmarkFit:
    angles = all_angles(poses.free)
    posed = skeleton.pose(poses.root, poses.wrist, angles, skeleton.offsets(beta))
    rms_m = float(np.sqrt(((posed.nodes - nodes) ** 2).sum(-1).mean()))
    turns = np.concatenate([poses.root[:, None], skeleton.local_rotations(angles)], 1)
    transl = poses.wrist - (skeleton.rest[0] + skeleton.shape[0] @ beta)
    motion = HandMotion(matrix_to_axis_angle(turns), beta, transl, fps, "right")
    return LandmarkFit(motion if side == "right" else mirrored(motion), scale, rms_m)


def _chosen(is_first: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(is_first.reshape(-1, *(1,) * (first.ndim - 1)), first, second)
