"""The motion of one hand in a filmed take: gaps bridged or left open, and a fit error for every frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...geometry.rotation import matrix_to_axis_angle
from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...records.side import Side
from ..motion import HandMotion, mirrored
from ..resampling import sampled_at, smoothed
from .articulation import NaturalPoses, all_angles
from .camera_fit import CameraPoses, CameraProblem, FitWeights, Sighting2D, at_nodes
from .initial_pose import MirrorSigns, mirror_signs
from .lifting import LiftedLandmarks, Lifting, mediapipe_lifting
from .skeleton import HandSkeleton

LONGEST_GAP_S = 0.5
"""Without a hand; a longer gap has no keys."""
MOST_FIT_ERROR = 0.06
"""Fit error above which a frame's landmarks are taken for a mistake."""
_STEPS = 20
_STEADY_S = 0.05  # deviation of the smoothing of all turns: a third less jitter; bends change by a tenth of a degree
_WEIGHTS = FitWeights(prior=0.3)  # frame after frame, with less to go by, natural poses must count fully
_PALM = (1, 5, 9, 13)
_SCALES = (0.2, 5.0)
_LEAST_SIZE = 1e-4  # of a hand in the picture, against the focal length
_LONGEST_SIDE_SHARE = 0.9
_MIRROR_X = np.array([-1.0, 1, 1])


@dataclass(frozen=True)
class FilmedHand:
    """One hand's landmarks in the N frames of a film that show it, in MediaPipe's order.

    Attributes:
        frames: [N] increasing indices.
        px: [N, 21, 2] in the picture.
        world: [N, 21, 3] m about the hand's centre, in the camera's axes.
    """

    frames: np.ndarray
    px: np.ndarray
    world: np.ndarray


@dataclass(frozen=True)
class FilmCamera:
    """A camera that does not move, its principal point in the middle.

    Attributes:
        size_px: (width, height).
        focal_px: focal length.
    """

    size_px: tuple[int, int]
    focal_px: float

    @classmethod
    def guessed(cls, size_px: tuple[int, int]) -> FilmCamera:
        """Guess an ordinary camera: a wrong guess moves the hand nearer or farther and hardly changes its pose."""
        return cls(size_px, _LONGEST_SIDE_SHARE * max(size_px))


@dataclass(frozen=True)
class TakeFit:
    """The motion of a hand from its first to its last sighting, in the camera's axes (OpenCV's).

    Attributes:
        motion: of F frames at equal steps.
        start_s: time of its first frame.
        is_keyed: [F] whether the frame was seen, or lies in a gap that is short enough to be bridged.
        fit_error: [F] root mean square distance of the hand from the landmarks in the picture, as a share of its size;
            1 where nothing was seen.
        rejected: frames of the film whose landmarks were taken for mistakes.
        mirror: what of the landmarks is as if mirrored.
    """

    motion: HandMotion
    start_s: float
    is_keyed: np.ndarray
    fit_error: np.ndarray
    rejected: int
    mirror: MirrorSigns = field(default_factory=MirrorSigns)


def fit_take(
    hand: FilmedHand,
    times: np.ndarray,
    camera: FilmCamera,
    model: HandModel,
    side: Side,
    fps: float,
    beta: np.ndarray | None = None,
    lifting: Lifting = mediapipe_lifting,
    weights: FitWeights | None = None,
) -> TakeFit:
    """Fit a hand of known shape to all frames of a take at once.

    Args:
        hand: its landmarks.
        times: [T] s of the film's frames, increasing.
        camera: of the film.
        model: any hand in MANO's format.
        side: of the hand.
        fps: of the motion; the film's own times may be uneven.
        beta: [10] its shape; None: the mean.
        lifting: what the tracker's landmarks say of the joints.
        weights: what the fit trusts besides.

    Raises:
        LiveHandError: the landmarks are not those of a hand.
    """
    skeleton, beta = HandSkeleton.of(model), np.zeros(10) if beta is None else beta
    seen = sighted(hand, times, camera, side, skeleton.offsets(beta), lifting)
    problem = CameraProblem(seen, skeleton, skeleton.offsets(beta), NaturalPoses.of_library(), weights or _WEIGHTS)
    parts = [_fitted(_cut(problem, frames)) for frames in _segments(seen)]
    poses = CameraPoses(*(np.concatenate(column) for column in zip(*(part[0] for part in parts), strict=True)))
    fit_error, rejected = np.concatenate([part[1] for part in parts]), sum(part[2] for part in parts)
    frames = np.concatenate([np.arange(segment.start, segment.stop) for segment in _segments(seen)])
    fit = _at_equal_steps(motion_of(poses, skeleton, beta, side, fps), fit_error, seen.times[frames], rejected)
    return replace(fit, mirror=mirror_signs(seen.world[seen.is_seen], skeleton))


def motion_of(
    poses: CameraPoses, skeleton: HandSkeleton, beta: np.ndarray, side: Side, fps: float | None = None
) -> HandMotion:
    """Convert a right hand's poses to the motion of a hand of a side."""
    local = skeleton.local_rotations(all_angles(poses.free))
    theta = matrix_to_axis_angle(np.concatenate([poses.root[:, None], local], 1))
    transl = poses.wrist - (skeleton.rest[0] + skeleton.shape[0] @ beta)
    motion = HandMotion(theta, beta, transl, fps, "right")
    return motion if side == "right" else mirrored(motion)


def sighted(
    hand: FilmedHand, times: np.ndarray, camera: FilmCamera, side: Side, offsets: np.ndarray, lifting: Lifting
) -> Sighting2D:
    """Sight a right hand whose bones have offsets [5, 4, 3] m, from the first to the last frame with the hand.

    Raises:
        LiveHandError: the landmarks are not those of a hand.
    """
    if not (np.isfinite(hand.px).all() and np.isfinite(hand.world).all()):
        raise LiveHandError("landmarks must be finite, got NaN or infinity; track the hand again")
    first, count = int(hand.frames[0]), int(hand.frames[-1] - hand.frames[0]) + 1
    rows = hand.frames - first
    picture_points = (hand.px - np.array(camera.size_px) / 2) / camera.focal_px
    size = np.ptp(picture_points, axis=1).max(-1)
    if not (size > _LEAST_SIZE).all():
        raise LiveHandError("landmarks in the picture must show a hand of some size, got points in one place")
    world = at_nodes(hand.world)
    palm = np.linalg.norm(world[:, _PALM] - world[:, :1], axis=-1).mean(1)
    scale = float(np.median(palm) / np.linalg.norm(offsets[:4, 0], axis=-1).mean())
    if not _SCALES[0] < scale < _SCALES[1]:
        raise LiveHandError(f"world landmarks must be a hand's, in metres, got one {scale:.3g} times as large")
    world = (world - world.mean(1, keepdims=True)) / scale
    mirror = _MIRROR_X if side == "left" else np.ones(3)
    picture_points, world = at_nodes(picture_points) * mirror[:2], world * mirror
    lifted = LiftedLandmarks(*(_filled(value, rows, count) for value in lifting(picture_points, world)))
    is_seen = np.zeros(count, bool)
    is_seen[rows] = True
    parts = (_filled(world, rows, count), _filled(size, rows, count))
    return Sighting2D(lifted, *parts, is_seen, times[first : first + count])


def _filled(values: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Spread values over [count, ...] at these rows, ones elsewhere."""
    filled = np.ones((count, *values.shape[1:]))
    filled[rows] = values
    return filled


def _segments(seen: Sighting2D) -> list[slice]:
    """Split into the parts between gaps that are too long to be bridged."""
    frames = np.flatnonzero(seen.is_seen)
    breaks = np.flatnonzero(np.diff(seen.times[frames]) > LONGEST_GAP_S)
    firsts, lasts = np.r_[frames[0], frames[breaks + 1]], np.r_[frames[breaks], frames[-1]]
    return [slice(int(first), int(last) + 1) for first, last in zip(firsts, lasts, strict=True)]


def _cut(problem: CameraProblem, frames: slice) -> CameraProblem:
    return replace(problem, sighting=problem.sighting.part(frames))


def _fitted(problem: CameraProblem) -> tuple[CameraPoses, np.ndarray, int]:
    """Fit poses, fit errors [T], number of rejected frames: the tracker's mistakes become gaps; all is fitted again."""
    poses = problem.solve(problem.initial(), _STEPS)
    fit_error = problem.reprojection(poses)
    is_wrong = fit_error > MOST_FIT_ERROR
    if is_wrong.any() and not (is_wrong | ~problem.sighting.is_seen).all():
        seen = replace(problem.sighting, is_seen=problem.sighting.is_seen & ~is_wrong)
        better = replace(problem, sighting=seen)
        poses = better.solve(better.initial(), _STEPS)
        fit_error = problem.reprojection(poses)
    return poses, np.where(np.isnan(fit_error), 1.0, np.minimum(fit_error, 1.0)), int(is_wrong.sum())


def _at_equal_steps(motion: HandMotion, fit_error: np.ndarray, times: np.ndarray, rejected: int) -> TakeFit:
    assert motion.fps is not None
    count = round(float(times[-1] - times[0]) * motion.fps) + 1
    wanted = times[0] + np.arange(count) / motion.fps
    right = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(times[left] - wanted) < np.abs(times[right] - wanted), left, right)
    is_keyed = (times[right] - times[left] <= LONGEST_GAP_S) | (np.abs(times[nearest] - wanted) < 0.5 / motion.fps)
    moved = sampled_at(motion, wanted, times)
    # The wrist's place stays: the film shows it.
    steady = replace(moved, theta=smoothed(moved, _STEADY_S * motion.fps).theta)
    return TakeFit(steady, float(times[0]), is_keyed, np.where(is_keyed, fit_error[nearest], 1.0), rejected)
