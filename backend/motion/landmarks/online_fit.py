"""Fits a hand frame after frame as they come: the residuals of the whole take, over its last few frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import matrix_to_axis_angle
from ...hand.model import HandModel
from ...records.shot import HandPose
from ...records.side import Side
from .articulation import NaturalPoses
from .camera_fit import CameraPoses, CameraProblem, FitWeights
from .lifting import Lifting, mediapipe_lifting
from .skeleton import HandSkeleton
from .take_fit import LONGEST_GAP_S, MOST_FIT_ERROR, FilmCamera, FilmedHand, motion_of, sighted

_STEPS, _FIRST_STEPS = 2, 10
_FRAMES = 4  # solved together
_HELD = 2  # of them, the oldest
_MOST_AHEAD = 1.0  # of the last step, by which a hand is expected to go on


class OnlinePose(NamedTuple):
    """A hand as it was seen last.

    Attributes:
        pose: in the camera's axes (OpenCV's).
        fit_error: as in `TakeFit`.
    """

    pose: HandPose
    fit_error: float


class _Sighted(NamedTuple):
    time_s: float
    px: np.ndarray
    world: np.ndarray


class OnlineFit:
    """One hand of known shape before a camera that does not move.

    Every frame takes two steps. The last few frames are solved together; the two oldest of them are held, and carry
    what was before.
    """

    def __init__(
        self,
        camera: FilmCamera,
        model: HandModel,
        side: Side,
        beta: np.ndarray | None = None,
        lifting: Lifting = mediapipe_lifting,
        weights: FitWeights | None = None,
    ):
        self._camera = camera
        self._side: Side = side
        self._skeleton, self._beta = HandSkeleton.of(model), np.zeros(10) if beta is None else beta
        self._offsets = self._skeleton.offsets(self._beta)
        self._lifting, self._weights = lifting, weights or FitWeights()
        self._seen: list[_Sighted] = []
        self._poses: CameraPoses | None = None

    def follow(self, time_s: float, px: np.ndarray, world: np.ndarray) -> OnlinePose | None:
        """Fit the hand in the next frame that shows it; None if its landmarks fit no hand.

        Args:
            time_s: of the frame, later than the last one's.
            px: [21, 2] landmarks in the picture, in MediaPipe's order.
            world: [21, 3] m about the hand's centre.

        Raises:
            LiveHandError: the landmarks are in one place, or of no hand's size.
        """
        seen = [*self._recent(time_s), _Sighted(time_s, px, world)]
        problem = self._problem(seen)
        poses = self._stepped(problem) if len(seen) > 1 else problem.solve(problem.initial(), _FIRST_STEPS)
        fit_error = float(problem.reprojection(poses)[-1])
        # It moved in a way that two steps cannot follow, or is no hand.
        if fit_error > MOST_FIT_ERROR and len(seen) > 1:
            seen = seen[-1:]
            problem = self._problem(seen)
            poses = problem.solve(problem.initial(), _FIRST_STEPS)
            fit_error = float(problem.reprojection(poses)[-1])
        if fit_error > MOST_FIT_ERROR:
            return None
        self._seen, self._poses = seen, poses
        last = CameraPoses(*(part[-1:] for part in poses))
        return OnlinePose(motion_of(last, self._skeleton, self._beta, self._side).pose(0), fit_error)

    def _recent(self, time_s: float) -> list[_Sighted]:
        """Select the last frames that a frame at this time still belongs to."""
        if not self._seen or time_s - self._seen[-1].time_s > LONGEST_GAP_S:
            return []
        return self._seen[-_FRAMES + 1 :]

    def _problem(self, seen: Sequence[_Sighted]) -> CameraProblem:
        times, px, world = (np.stack(column) for column in zip(*seen, strict=True))
        hand = FilmedHand(np.arange(len(seen)), px, world)
        sighting = sighted(hand, times, self._camera, self._side, self._offsets, self._lifting)
        natural = NaturalPoses.of_library()
        return CameraProblem(sighting, self._skeleton, self._offsets, natural, self._weights)

    def _stepped(self, problem: CameraProblem) -> CameraPoses:
        """Take two steps, from where the last frames were and from where the hand goes on to."""
        assert self._poses is not None
        count = len(problem.sighting.times)
        known = CameraPoses(*(part[1 - count :] for part in self._poses))
        guess = _ahead(known, problem.sighting.times)
        poses = CameraPoses(*(np.concatenate(both) for both in zip(known, guess, strict=True)))
        return problem.solve(poses, _STEPS, held=_HELD if count == _FRAMES else 0)


def _ahead(poses: CameraPoses, times: np.ndarray) -> CameraPoses:
    """Extrapolate to the last of the times, as if the hand goes on as it did before."""
    last = CameraPoses(*(part[-1:] for part in poses))
    if len(poses.wrist) < 2:
        return last
    before = CameraPoses(*(part[-2:-1] for part in poses))
    share = min((times[-1] - times[-2]) / (times[-2] - times[-3]), _MOST_AHEAD)
    turn = matrix_to_axis_angle(last.root @ before.root.swapaxes(1, 2))
    moves = np.concatenate([turn, last.wrist - before.wrist, last.free - before.free], 1)
    return last.stepped(share * moves)
