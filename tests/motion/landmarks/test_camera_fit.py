"""A filmed take: the solver against a dense one, what the fit gets back from true landmarks, and takes as they are."""

import time
from functools import partial

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.joint_limits import LIMITS
from livehand.backend.hand.model import MIRROR_POINT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.articulation import NaturalPoses, all_angles
from livehand.backend.motion.landmarks.camera_fit import (
    CameraPoses,
    CameraProblem,
    FitWeights,
    Sighting2D,
    placed,
    solve_pentadiagonal,
)
from livehand.backend.motion.landmarks.lifting import LiftedLandmarks
from livehand.backend.motion.landmarks.skeleton import HandSkeleton, node_jacobian
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand, fit_take, sighted
from livehand.backend.motion.motion import HandMotion, mirrored
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.records.errors import LiveHandError
from livehand.tests.builders import joints_as_tracked

pytestmark = pytest.mark.slow

HAND = load_default_hand()
SKELETON = HandSkeleton.of(HAND)
CAMERA = FilmCamera((640, 480), 620.0)
EXACT = partial(joints_as_tracked, deviation=0.005)


def fitted(hand, times, side="right", fps=30.0, **more):
    return fit_take(hand, times, CAMERA, HAND, side, fps, lifting=EXACT, **more)


def angles_deg(motion, truth):
    """[T, 16] between the joints' rotations."""
    both = axis_angle_to_matrix(motion.theta).swapaxes(-1, -2) @ axis_angle_to_matrix(truth.theta)
    return np.rad2deg(np.linalg.norm(matrix_to_axis_angle(both), axis=-1))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 12])
def test_the_block_solver_is_a_dense_one(count):
    rng, n = np.random.default_rng(count), 4
    diagonal = rng.normal(size=(count, n, n))
    diagonal = diagonal @ diagonal.swapaxes(1, 2) + 8 * np.eye(n)
    ties = [rng.normal(size=(max(count - shift, 0), n)) for shift in (1, 2)]
    right, dense = rng.normal(size=(count, n)), np.zeros((count, n, count, n))
    for frame in range(count):
        dense[frame, :, frame] = diagonal[frame]
        for shift, tie in enumerate(ties, 1):
            if frame + shift < count:
                dense[frame, :, frame + shift] = dense[frame + shift, :, frame] = np.diag(tie[frame])
    expected = np.linalg.solve(dense.reshape(count * n, -1), right.ravel())
    np.testing.assert_allclose(solve_pentadiagonal(diagonal, *ties, right).ravel(), expected, atol=1e-12)


def test_true_landmarks_give_the_pose_back(made, seen):
    """The solver's floor: 21 of 45 angles are free, and a picture shows no depth."""
    errors, wrists = [], []
    for seed in range(4):
        truth, points = made(seed=seed)
        fit = fitted(seen(points), np.arange(30) / 30)
        errors.append(angles_deg(fit.motion, truth)[:, 1:])
        wrists.append(angles_deg(fit.motion, truth)[:, 0])
        assert fit.fit_error.max() < 0.02
        assert fit.rejected == 0
    assert np.mean(errors) < 3.0
    assert np.mean(wrists) < 2.5


def test_a_left_hand_is_the_mirror_image(made, seen):
    _truth, points = made()
    right = fitted(seen(points), np.arange(30) / 30)
    left = fitted(seen(points * MIRROR_POINT), np.arange(30) / 30, side="left")
    assert left.motion.side == "left"
    np.testing.assert_allclose(mirrored(left.motion).theta, right.motion.theta, atol=1e-6)
    np.testing.assert_allclose(mirrored(left.motion).transl, right.motion.transl, atol=1e-6)


def test_short_gaps_are_bridged_and_long_ones_left_open(made, seen):
    truth, points = made(90)
    frames = np.r_[0:20, 30:45, 70:90]  # 11 frames are a gap of 0.37 s, 26 of 0.87 s
    fit = fitted(seen(points, frames), np.arange(90) / 30)
    assert len(fit.motion) == 90
    assert fit.is_keyed.tolist() == [frame < 45 or frame >= 70 for frame in range(90)]
    assert (fit.fit_error[20:30] == 1).all()
    bridged = angles_deg(fit.motion, truth)[20:30]
    assert bridged[:, 0].mean() < 12
    np.testing.assert_allclose(fit.motion.transl[20:30], truth.transl[20:30], atol=0.03)


def test_the_motion_begins_where_the_hand_is_first_seen(made, seen):
    truth, points = made()
    fit = fitted(seen(points, np.arange(6, 20)), np.arange(30) / 30)
    assert fit.start_s == pytest.approx(0.2)
    assert len(fit.motion) == 14
    assert angles_deg(fit.motion, HandMotion(truth.theta[6:20], np.zeros(10), truth.transl[6:20]))[:, 1:].mean() < 4


def test_uneven_times_come_out_even(made, seen):
    truth, points = made(60)
    kept = np.sort(np.random.default_rng(0).choice(np.arange(1, 59), 40, replace=False))
    kept = np.r_[0, kept, 59]
    fit = fitted(seen(points[kept]), kept / 30)
    assert len(fit.motion) == 60
    assert fit.is_keyed.all()
    assert angles_deg(fit.motion, truth)[:, 1:].mean() < 3.5


def test_a_tracker_that_was_wrong_for_some_frames_is_not_believed(made, seen):
    truth, points = made(40)
    hand = seen(points)
    hand.px[15:18] = hand.px[15:18][:, ::-1]
    fit = fitted(hand, np.arange(40) / 30)
    assert fit.rejected >= 3
    assert (fit.fit_error[15:18] > 0.06).all()
    assert angles_deg(fit.motion, truth)[15:18, 0].max() < 8


def test_one_frame_and_two(made, seen):
    _, points = made()
    for count in (1, 2):
        fit = fitted(seen(points[:count]), np.arange(count) / 30)
        assert len(fit.motion) == count
        assert np.isfinite(fit.motion.theta).all()


def test_the_focal_length_moves_the_hand_and_hardly_its_pose(made, seen):
    truth, points = made()
    hand = seen(points)
    wide = fit_take(hand, np.arange(30) / 30, FilmCamera((640, 480), 434.0), HAND, "right", 30.0, lifting=EXACT)
    assert angles_deg(wide.motion, truth)[:, 1:].mean() < 6
    distance = (wide.motion.transl + rest_wrists(HAND, np.zeros(10)))[:, 2].mean()
    assert distance == pytest.approx(0.7 * points[:, 0, 2].mean(), rel=0.1)


def test_landmarks_that_are_no_hand(made, seen):
    _, points = made()
    with pytest.raises(LiveHandError, match="as large"):
        fitted(FilmedHand(np.arange(30), seen(points).px, 100 * points), np.arange(30) / 30)
    with pytest.raises(LiveHandError, match="some size"):
        fitted(FilmedHand(np.arange(30), np.zeros((30, 21, 2)), points), np.arange(30) / 30)


def test_the_place_of_points_in_closed_form():
    rng = np.random.default_rng(0)
    points, place = rng.normal(size=(5, 21, 3)) * 0.05, rng.normal(size=(5, 3)) * 0.1 + (0, 0, 0.5)
    at = points + place[:, None]
    np.testing.assert_allclose(placed(points, at[..., :2] / at[..., 2:]), place, atol=1e-6)


def problem_of(count=8):
    times = np.cumsum(np.random.default_rng(3).uniform(0.01, 0.08, count))
    lifted = LiftedLandmarks(np.zeros((count, 21, 2)), *(np.ones((count, 21)) for _ in range(3)))
    sighting = Sighting2D(lifted, np.zeros((count, 21, 3)), np.ones(count), np.zeros(count, bool), times)
    return CameraProblem(sighting, SKELETON, SKELETON.offsets(np.zeros(10)), NaturalPoses.of_library(), FitWeights())


def test_even_motion_costs_nothing_whatever_the_times():
    problem = problem_of()
    times = problem.sighting.times[:, None]
    mean = np.broadcast_to(problem.natural.mean, (8, 21))
    turning = axis_angle_to_matrix(times * [0.5, -1.0, 0.3])
    poses = CameraPoses(turning, times * [0.1, 0.2, -0.1] + [0, 0, 0.5], mean.copy())
    assert problem.cost(poses) == pytest.approx(0, abs=1e-12)
    assert problem.cost(CameraPoses(turning, np.sin(9 * poses.wrist), mean.copy())) > 0.1


def test_slopes_of_the_nodes():
    """Against central differences of the posed skeleton."""
    rng = np.random.default_rng(0)
    free = rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (1, 21)) / 2
    angles, root, wrist = all_angles(free), axis_angle_to_matrix(rng.normal(size=(1, 3))), rng.normal(size=(1, 3))
    offsets = SKELETON.offsets(np.zeros(10))

    def nodes(step):
        turned = axis_angle_to_matrix(step[None, :3]) @ root
        return SKELETON.pose(turned, wrist + step[3:6], angles + step[6:].reshape(5, 3, 3), offsets).nodes[0]

    slopes = node_jacobian(SKELETON.pose(root, wrist, angles, offsets))[0]
    for column in range(51):
        step = np.zeros(51)
        step[column] = 1e-6
        expected = (nodes(step) - nodes(-step)) / 2e-6
        np.testing.assert_allclose(slopes[..., column], expected, atol=1e-7)


def test_a_step_goes_down_the_slope_of_the_cost(made, seen):
    """The right side of the normal equations is minus half the gradient, lifted angles included: by differences."""
    _, points = made(3)
    rng = np.random.default_rng(0)

    def reported(picture_points, world):
        return joints_as_tracked(picture_points, world)._replace(
            free=rng.normal(size=(3, 21)) * 0.1, free_sd=np.full((3, 21), 0.2)
        )

    offsets = SKELETON.offsets(np.zeros(10))
    sighting = sighted(seen(points), np.arange(3) / 30, CAMERA, "right", offsets, reported)
    problem = CameraProblem(sighting, SKELETON, offsets, NaturalPoses.of_library(), FitWeights())
    start = problem.initial()
    poses = CameraPoses(start.root, start.wrist, np.clip(start.free, LIMITS[:, 0] + 0.01, LIMITS[:, 1] - 0.01))
    _, right = problem._normal(poses, sighting)
    problem._add_smoothness(np.zeros((3, 27, 27)), right, poses)
    for column in (1, 4, 6, 12, 26):
        step = np.zeros((3, 27))
        step[1, column] = 1e-5
        slope = (problem.cost(poses.stepped(step)) - problem.cost(poses.stepped(-step))) / 2e-5
        assert slope == pytest.approx(-2 * right[1, column], rel=2e-2, abs=0.5)


@pytest.mark.slow
def test_time_and_memory_of_a_long_take(made, seen):
    """Measured 2 ms a frame; memory is that of reading the hand, 540 MB, also for 2,000 frames."""
    import tracemalloc

    _, points = made(200)
    points = np.concatenate([points, points[::-1]] * 5)
    tracemalloc.start()
    started = time.process_time()
    fit = fitted(seen(points), np.arange(2000) / 30)
    seconds, most = time.process_time() - started, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(fit.motion) == 2000
    assert most < 0.7e9
    assert seconds / 2000 < 0.02
