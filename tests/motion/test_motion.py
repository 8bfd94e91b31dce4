"""Motions: what they refuse, mirrored, in other frame rates, in other spaces."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, axis_angle_to_quaternion
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_POINT
from livehand.backend.motion.motion import HandMotion, mirrored, motion_from_poses
from livehand.backend.motion.resampling import resampled, sampled_at, slerp, smoothed
from livehand.backend.motion.spaces import SPACES, rest_wrists, to_blender, transformed
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose


def motion(count=5, seed=0, **changes):
    rng = np.random.default_rng(seed)
    fields = {
        "theta": rng.normal(size=(count, 16, 3)) * 0.7,
        "beta": rng.normal(size=10),
        "transl": rng.normal(size=(count, 3)) * 0.2,
        "fps": 30.0,
    }
    return HandMotion(**{**fields, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"theta": np.zeros((0, 16, 3))}, "at least one frame"),
        ({"theta": np.zeros((5, 48))}, r"theta of 5 frames must be \[5, 16, 3\], got \[5, 48\]"),
        ({"beta": np.zeros(9)}, r"beta .* \[10\] or \[5, 10\], got \[9\]"),
        ({"transl": np.zeros((4, 3))}, r"transl .* got \[4, 3\]"),
        ({"transl": np.array([[0.0] * 3] * 3 + [[0, np.nan, 0]] * 2)}, "in 2 of 5 frames, the first at index 3"),
        ({"beta": np.full(10, np.inf)}, "beta must be finite"),
        ({"fps": 0.0}, "fps must be a positive"),
        ({"forearm": np.zeros((4, 3))}, r"forearm .* \[3\] or \[5, 3\], got \[4, 3\]"),
        ({"forearm": np.full(3, np.nan)}, "forearm must be finite"),
    ],
)
def test_what_is_no_motion_is_refused(changes, message):
    with pytest.raises(LiveHandError, match=message):
        motion(**changes)


@pytest.fixture
def armed(hand):
    """The built-in hand whose stump turns as a forearm."""
    return replace(hand, arm_weights=hand.lbs_weights[:, 0] * (hand.v_template[:, 0] > hand.joints[0, 0]))


def bent(count=5, **changes):
    """A motion whose forearm turns."""
    return motion(count, forearm=np.random.default_rng(7).normal(size=(count, 3)) * 0.5, **changes)


def test_the_mirrored_motion_is_the_mirror_image_of_the_surface(hand):
    right = motion()
    left = mirrored(right)
    assert left.side == "left"
    expected = posed_vertices(hand, right.pose(3)) * MIRROR_POINT
    np.testing.assert_allclose(posed_vertices(hand, left.pose(3)), expected, atol=1e-12)
    np.testing.assert_array_equal(mirrored(left).theta, right.theta)


def test_the_forearm_is_mirrored_and_carried_with_the_surface(armed):
    right, matrix = bent(), np.eye(4)
    straight = replace(right, forearm=np.zeros(3))
    assert np.abs(posed_vertices(armed, right.pose(3)) - posed_vertices(armed, straight.pose(3))).max() > 0.002
    expected = posed_vertices(armed, right.pose(3)) * MIRROR_POINT
    np.testing.assert_allclose(posed_vertices(armed, mirrored(right).pose(3)), expected, atol=1e-12)
    matrix[:3, :3], matrix[:3, 3] = axis_angle_to_matrix(np.array([0.3, -1.2, 2.0])), (0.1, 0.2, -0.3)
    carried = transformed(right, matrix, rest_wrists(armed, right.beta))
    expected = posed_vertices(armed, right.pose(4)) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(posed_vertices(armed, carried.pose(4)), expected, atol=1e-9)


def test_a_forearm_turns_on_between_frames_and_is_smoothed_like_the_joints():
    turning = replace(motion(9), forearm=np.outer(0.2 * np.arange(9), [0, 0, 1.0]))
    np.testing.assert_allclose(resampled(turning, 60.0).forearm[:, 2], 0.1 * np.arange(17), atol=1e-12)
    np.testing.assert_allclose(smoothed(turning, 1.0).forearm[4], turning.forearm[4], atol=1e-12)
    straight = resampled(replace(turning, forearm=np.array([0, 0.1, 0])), 60.0)
    np.testing.assert_array_equal(straight.forearms, np.tile([0, 0.1, 0], (17, 1)))
    np.testing.assert_array_equal(smoothed(straight, 2.0).forearm, straight.forearm)


def test_poses_with_forearms_become_a_motion():
    poses = [replace(HandPose.rest("right"), forearm=np.full(3, 0.1 * k)) for k in range(3)]
    joined = motion_from_poses(poses)
    np.testing.assert_array_equal(joined.forearm[:, 0], [0, 0.1, 0.2])
    np.testing.assert_array_equal(joined.pose(2).forearm, poses[2].forearm)
    assert motion_from_poses(poses[:1] * 3).forearm.shape == (3,)


def test_poses_become_a_motion_of_one_shape_and_one_side():
    poses = [HandPose(np.full((16, 3), k), np.ones(10), np.zeros(3), "left") for k in range(3)]
    joined = motion_from_poses(poses, 24.0)
    assert (len(joined), joined.beta.shape, joined.side, joined.fps) == (3, (10,), "left", 24.0)
    assert joined.pose(2).theta[0, 0] == 2
    with pytest.raises(LiveHandError, match="of one hand"):
        motion_from_poses([*poses, HandPose.rest("right")])


def test_a_constant_rotation_speed_is_kept_at_any_rate():
    """Closed form: 0.3 rad a frame about one axis, through more than half a turn, at 30 -> 24 and -> 120 fps."""
    theta = np.zeros((13, 16, 3))
    angle = 0.3 * np.arange(13)
    theta[:, 4, 2] = (angle + np.pi) % (2 * np.pi) - np.pi
    turning = motion(13, theta=theta, transl=np.outer(np.arange(13), [1.0, 0, 0]))
    for fps, count in ((24.0, 10), (120.0, 49), (30.0, 13)):
        other = resampled(turning, fps)
        assert (len(other), other.fps) == (count, fps)
        expected = axis_angle_to_matrix(np.outer(0.3 * np.arange(count) * 30 / fps, [0, 0, 1.0]))
        np.testing.assert_allclose(axis_angle_to_matrix(other.theta[:, 4]), expected, atol=1e-9)
        np.testing.assert_allclose(other.transl[:, 0], np.arange(count) * 30 / fps, atol=1e-12)


def test_a_rate_that_nobody_knows_is_not_converted():
    with pytest.raises(LiveHandError, match="must be known"):
        resampled(motion(fps=None), 24.0)
    with pytest.raises(LiveHandError, match="positive"):
        resampled(motion(), -1.0)


def test_gaps_are_bridged_at_the_right_places():
    known = motion(3)
    whole = sampled_at(known, np.arange(6), times=np.array([0, 1, 5]))
    np.testing.assert_allclose(axis_angle_to_matrix(whole.theta[[0, 1, 5]]), axis_angle_to_matrix(known.theta))
    np.testing.assert_allclose(whole.transl[3], (known.transl[1] + known.transl[2]) / 2)


def test_slerp_goes_the_short_way_whatever_the_signs():
    one, other = axis_angle_to_quaternion(np.array([[0.2, 0, 0], [1.0, 0, 0]]))
    for end in (other, -other):
        half = slerp(one, end, np.array(0.25))
        np.testing.assert_allclose(half, axis_angle_to_quaternion(np.array([0.4, 0, 0])), atol=1e-12)
    np.testing.assert_allclose(slerp(one, one, np.array(0.5)), one)


def test_smoothing_takes_jitter_and_leaves_a_steady_turn():
    steady = np.zeros((41, 16, 3))
    steady[:, 2, 0] = np.linspace(0, 1, 41)
    noise = np.random.default_rng(1).normal(size=steady.shape) * 0.05
    noisy = smoothed(motion(41, theta=steady + noise, transl=np.zeros((41, 3))), 2.0)
    inner = slice(8, 33)
    assert np.abs(noisy.theta[inner] - steady[inner]).mean() < 0.4 * np.abs(noise[inner]).mean()
    clean = smoothed(motion(41, theta=steady, transl=np.zeros((41, 3))), 2.0)
    np.testing.assert_allclose(clean.theta[inner], steady[inner], atol=1e-9)
    assert smoothed(noisy, 0.0) is noisy


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_moved_motion_moves_the_surface(hand, side):
    """Against the slow way: pose, then transform the vertices."""
    still = motion(side=side)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axis_angle_to_matrix(np.array([0.3, -1.2, 2.0])), (0.1, 0.2, -0.3)
    carried = transformed(still, matrix, rest_wrists(hand.for_side(side), still.beta))
    for index in (0, 4):
        expected = posed_vertices(hand, still.pose(index)) @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(posed_vertices(hand, carried.pose(index)), expected, atol=1e-9)


def test_spaces_are_brought_into_blenders_world():
    up = {"z_up": (0, 0, 1), "y_up": (0, 1, 0), "opencv": (0, -1, 0), "opengl": (0, 1, 0)}
    ahead = {"z_up": (0, 1, 0), "y_up": (0, 0, -1), "opencv": (0, 0, 1), "opengl": (0, 0, -1)}
    for space in up:
        turn = to_blender(space)[:3, :3]
        np.testing.assert_array_equal(turn @ up[space], (0, 0, 1))
        np.testing.assert_array_equal(turn @ ahead[space], (0, 1, 0))
        assert np.linalg.det(turn) == pytest.approx(1)
    assert set(SPACES) == {*up, "hand"}
