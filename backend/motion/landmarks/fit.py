"""Fits poses of a hand model to landmarks of its joints and fingertips.

The fit is a maximum a posteriori estimate: landmarks have a normal error, free angles the distribution of natural poses
and hard limits, and all frames share one shape. It alternates between the poses of all frames, by Levenberg-Marquardt,
and the shape, by linear least squares. If the scale of the landmarks is unknown, it is removed first.

Landmarks onto which the hand can be brought to a hundredth of a millimetre are no tracker's but a hand model's:
natural poses say nothing then, the shape is that of the bones' lengths, and the pose is theirs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...hand.joint_limits import FREE
from ...hand.model import MIRROR_POINT, HandModel
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..motion import HandMotion, mirrored
from .articulation import NaturalPoses, all_angles, within_limits
from .bone_lengths import shape_of_lengths
from .initial_pose import aligned_bones, aligned_palm
from .skeleton import NODES_OF_LANDMARKS, HandSkeleton, PosedSkeleton, node_jacobian

_ROUNDS = 4  # alternations between poses and shape
_STEPS = 6  # of the poses per round
_FRAMES_AT_ONCE = 500  # bounds memory
_FRAMES_FOR_SIDE = 40  # used to find out which hand it is
_SCALES = (0.4, 2.5)
_FARTHEST_M = 10.0  # from the wrist, that a tracker may err
_FRAMES_FOR_EXACT = 12  # tried first
_EXACT_RMS_M = 1e-5
_EXACT_LENGTH_M = 1e-6  # standard deviation of their bones' lengths
_MOST_BETA = 4.0
_COLUMNS = np.concatenate([np.arange(6), 6 + FREE])


class LandmarkNoise(NamedTuple):
    """The accuracy of landmarks.

    Attributes:
        deviation_m: standard deviation from the model's joints and fingertips, along each axis.
        fits_scale: the scale of the landmarks is unknown and is fitted.
    """

    deviation_m: float
    fits_scale: bool


METRIC = LandmarkNoise(0.004, fits_scale=False)
"""Of a tracker that measures distances."""
MONOCULAR = LandmarkNoise(0.008, fits_scale=True)
"""Of a tracker that estimates depth and size from one image, as MediaPipe does."""
_EXACT = LandmarkNoise(1e-5, fits_scale=False)


@dataclass(frozen=True)
class LandmarkFit:
    """The result of a fit.

    Attributes:
        motion: in the space of the landmarks, m.
        scale: of the landmarks against the hand; it is removed from the motion, about each frame's centre.
        rms_m: root mean square distance between landmarks and model.
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
    points: np.ndarray, model: HandModel, side: Side, fps: float | None = None, noise: LandmarkNoise = MONOCULAR
) -> LandmarkFit:
    """Fit the motion of a hand model to landmarks.

    Args:
        points: [T, 21, 3] m, in MediaPipe's order.
        model: any hand in MANO's format.
        side: of the hand that the landmarks and the motion are of.
        fps: of the landmarks.
        noise: of the landmarks; it sets their weight against natural poses and the model's own size.

    Raises:
        LiveHandError: the landmarks are empty, not finite, of another shape, or not those of a hand in metres.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 3 or points.shape[1:] != (21, 3) or len(points) == 0 or not np.isfinite(points).all():
        raise LiveHandError(
            f"landmarks must be finite and [T, 21, 3] m, got {list(points.shape)}; track the hand again"
        )
    nodes = np.empty_like(points)
    nodes[:, NODES_OF_LANDMARKS] = points if side == "right" else points * MIRROR_POINT
    skeleton = HandSkeleton.of(model)
    scale = _scale(nodes, skeleton)
    _check_reach(nodes)
    some = nodes[:: max(1, len(nodes) // _FRAMES_FOR_EXACT)]
    scales = (1.0, scale) if noise.fits_scale else (1.0,)
    exact = next((one for one in scales if _is_exact(_without_scale(some, one), skeleton)), None)
    scale = exact or scales[-1]
    fit = _exact_fit if exact else _fit
    poses, beta, rms_m = fit(_without_scale(nodes, scale), skeleton, _EXACT if exact else noise)
    motion = _motion(poses, skeleton, beta, fps)
    return LandmarkFit(motion if side == "right" else mirrored(motion), scale, rms_m)


def _fit(nodes: np.ndarray, skeleton: HandSkeleton, noise: LandmarkNoise) -> tuple[_Poses, np.ndarray, float]:
    """Fit poses and beta [10] to nodes [T, 21, 3] m of the hand's scale; the last is the root mean square distance."""
    beta, natural = np.zeros(10), NaturalPoses.of_gestures()
    poses = _initial_poses(nodes, skeleton, beta)
    for _ in range(_ROUNDS):
        poses = _refined(poses, nodes, skeleton, beta, natural, noise)
        beta = _fitted_beta(poses, nodes, skeleton, noise)
    poses = _refined(poses, nodes, skeleton, beta, natural, noise)
    return poses, beta, _rms_m(poses, nodes, skeleton, beta)


def _is_exact(nodes: np.ndarray, skeleton: HandSkeleton) -> bool:
    """Tell whether nodes [T, 21, 3] m are those of the hand model itself, in a shape that people have."""
    _, beta, rms_m = _exact_fit(nodes, skeleton, _EXACT)
    return rms_m < _EXACT_RMS_M and bool(np.abs(beta).max() <= _MOST_BETA)


def _exact_fit(nodes: np.ndarray, skeleton: HandSkeleton, noise: LandmarkNoise) -> tuple[_Poses, np.ndarray, float]:
    """Fit as `_fit` does where the bones' lengths tell the shape."""
    beta, natural = shape_of_lengths(nodes, skeleton, _EXACT_LENGTH_M), NaturalPoses.of_gestures()
    poses = _initial_poses(nodes, skeleton, beta)
    for _ in range(_ROUNDS):
        poses = _refined(poses, nodes, skeleton, beta, natural, noise)
    return poses, beta, _rms_m(poses, nodes, skeleton, beta)


def _rms_m(poses: _Poses, nodes: np.ndarray, skeleton: HandSkeleton, beta: np.ndarray) -> float:
    """Compute the root mean square distance of posed nodes from those wanted [T, 21, 3] m."""
    posed = skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), skeleton.offsets(beta))
    return float(np.sqrt(((posed.nodes - nodes) ** 2).sum(-1).mean()))


def side_errors(points: np.ndarray, model: HandModel) -> dict[Side, float]:
    """Measure the root mean square distance, m, of landmarks [T, 21, 3] m from a hand of each side, in <= 40 frames."""
    some = points[:: max(1, len(points) // _FRAMES_FOR_SIDE)]
    return {side: fit_landmarks(some, model, side).rms_m for side in SIDES}


def palm_m(model: HandModel) -> float:
    """Compute mean distance of the four knuckles from the wrist, which no pose changes."""
    return float(np.linalg.norm(HandSkeleton.of(model).offsets(np.zeros(10))[:4, 0], axis=-1).mean())


def _scale(nodes: np.ndarray, skeleton: HandSkeleton) -> float:
    """Compute the scale of the palm's bones, which no pose changes, against the mean shape's."""
    with np.errstate(over="ignore"):
        palm = np.linalg.norm(nodes[:, [1, 5, 9, 13]] - nodes[:, :1], axis=-1).mean()
    scale = float(palm / np.linalg.norm(skeleton.offsets(np.zeros(10))[:4, 0], axis=-1).mean())
    if not _SCALES[0] < scale < _SCALES[1]:
        raise LiveHandError(
            f"landmarks must be a hand's, in metres, got one {scale:.3g} times as large{_unit_guess(scale)}; "
            "give world landmarks, not those in the image, or change the unit"
        )
    return scale


def _unit_guess(scale: float) -> str:
    """Word which power of ten a hand's size is off by, if it is off by one."""
    power = round(np.log10(scale)) if np.isfinite(scale) and scale > 0 else 0
    if not power or not _SCALES[0] < scale / 10.0**power < _SCALES[1]:
        return ""
    return f", as if its unit were {10.0 ** abs(power):g} times {'larger' if power < 0 else 'smaller'}"


def _check_reach(nodes: np.ndarray) -> None:
    """Raise if a node of [T, 21, 3] m is where no tracker puts a hand's: the fit would be of that node alone."""
    with np.errstate(over="ignore"):
        reach_m = np.abs(nodes - nodes[:, :1]).max((1, 2))
    if reach_m.max() > _FARTHEST_M:
        raise LiveHandError(
            f"landmarks must lie within {_FARTHEST_M:g} m of the wrist, got one {reach_m.max():.3g} m away in "
            f"frame {reach_m.argmax() + 1} of those with a hand; leave that frame out, or track the hand again"
        )


def _without_scale(nodes: np.ndarray, scale: float) -> np.ndarray:
    """Divide nodes [T, 21, 3] by a scale, about each frame's centre."""
    centre = nodes.mean(1, keepdims=True)
    return centre + (nodes - centre) / scale


def _initial_poses(nodes: np.ndarray, skeleton: HandSkeleton, beta: np.ndarray) -> _Poses:
    root, wrist = aligned_palm(nodes, skeleton.rest + skeleton.shape @ beta)
    return _Poses(root, wrist, within_limits(aligned_bones(nodes, root, skeleton, beta)))


def _refined(
    poses: _Poses,
    nodes: np.ndarray,
    skeleton: HandSkeleton,
    beta: np.ndarray,
    natural: NaturalPoses,
    noise: LandmarkNoise,
) -> _Poses:
    """Refine the poses by a few Levenberg-Marquardt steps, for the shape beta."""
    parts = []
    for first in range(0, len(nodes), _FRAMES_AT_ONCE):
        frames = slice(first, first + _FRAMES_AT_ONCE)
        problem = _PoseProblem(nodes[frames], skeleton, skeleton.offsets(beta), natural, noise.deviation_m)
        parts.append(problem.solve(_Poses(*(part[frames] for part in poses))))
    return _Poses(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _PoseProblem:
    """The poses of one shape that bring its nodes to [T, 21, 3] m."""

    nodes: np.ndarray
    skeleton: HandSkeleton
    offsets: np.ndarray
    natural: NaturalPoses
    deviation_m: float

    def solve(self, poses: _Poses) -> _Poses:
        """Step all frames at once. A frame that a step makes worse is kept, and its damping raised."""
        posed = self._posed(poses)
        cost, damping = self._cost(poses, posed), np.full(len(self.nodes), 1e-2)
        for _ in range(_STEPS):
            new = self._stepped(poses, posed, damping)
            new_posed = self._posed(new)
            new_cost = self._cost(new, new_posed)
            is_better = new_cost <= cost
            poses = _Poses(*(_chosen(is_better, *pair) for pair in zip(new, poses, strict=True)))
            posed = PosedSkeleton(*(_chosen(is_better, *pair) for pair in zip(new_posed, posed, strict=True)))
            cost, damping = np.where(is_better, new_cost, cost), np.where(is_better, damping / 5, damping * 10)
        return poses

    def _stepped(self, poses: _Poses, posed: PosedSkeleton, damping: np.ndarray) -> _Poses:
        jacobian = node_jacobian(posed)[..., _COLUMNS].reshape(len(self.nodes), 63, len(_COLUMNS))
        residual = (self.nodes - posed.nodes).reshape(len(self.nodes), 63, 1)
        matrix = jacobian.swapaxes(1, 2) @ jacobian / self.deviation_m**2
        right = (jacobian.swapaxes(1, 2) @ residual)[..., 0] / self.deviation_m**2
        matrix[:, 6:, 6:] += self.natural.precision
        right[:, 6:] -= (poses.free - self.natural.mean) @ self.natural.precision
        diagonal = np.einsum("tkk->tk", matrix)
        diagonal += damping[:, None] * diagonal
        step = np.linalg.solve(matrix, right[..., None])[..., 0]
        root = axis_angle_to_matrix(step[:, :3]) @ poses.root
        return _Poses(root, poses.wrist + step[:, 3:6], within_limits(poses.free + step[:, 6:]))

    def _posed(self, poses: _Poses) -> PosedSkeleton:
        return self.skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), self.offsets)

    def _cost(self, poses: _Poses, posed: PosedSkeleton) -> np.ndarray:
        """Compute [T] twice the negative logarithm of the posterior, but for a constant."""
        misfit = ((self.nodes - posed.nodes) ** 2).sum((1, 2)) / self.deviation_m**2
        off = poses.free - self.natural.mean
        return misfit + ((off @ self.natural.precision) * off).sum(-1)


def _fitted_beta(poses: _Poses, nodes: np.ndarray, skeleton: HandSkeleton, noise: LandmarkNoise) -> np.ndarray:
    """Fit the one beta [10] of all frames, with unit variance a priori; centred nodes are linear in it."""
    posed = skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), skeleton.offsets(np.zeros(10)))
    rest, slopes = skeleton.shape_terms(posed.rotations)
    rest, slopes, nodes = (values - values.mean(1, keepdims=True) for values in (rest, slopes, nodes))
    columns = slopes.reshape(-1, 10) / noise.deviation_m
    residual = (nodes - rest).reshape(-1) / noise.deviation_m
    return np.linalg.solve(columns.T @ columns + np.eye(10), columns.T @ residual)


def _motion(poses: _Poses, skeleton: HandSkeleton, beta: np.ndarray, fps: float | None) -> HandMotion:
    """Convert to the motion of the right hand."""
    local = skeleton.local_rotations(all_angles(poses.free))
    theta = matrix_to_axis_angle(np.concatenate([poses.root[:, None], local], 1))
    transl = poses.wrist - (skeleton.rest[0] + skeleton.shape[0] @ beta)
    return HandMotion(theta, beta, transl, fps, "right")


def _chosen(is_first: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(is_first.reshape(-1, *(1,) * (first.ndim - 1)), first, second)
