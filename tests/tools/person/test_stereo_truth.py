"""The truth of two cameras: bones keep their lengths, points come nearer to the true ones, and exact ones stay."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.person.rig.triangulation import projected, triangulated
from livehand.tools.person.stereo_truth import (
    CHAINS,
    CalibratedLens,
    Path3D,
    stereo_truth,
    straightened,
    with_constant_bones,
)

FRAMES = 60
LENGTHS_M = np.array([[35, 40, 32, 25], [90, 42, 25, 21], [88, 46, 27, 22], [82, 42, 26, 22], [78, 34, 19, 18]]) / 1000
FOCAL_PX = 900, 910


def lens(turn):
    """A camera .6 m in front of the origin, turned about it."""
    K = np.array([[FOCAL_PX[0], 0, 350], [0, FOCAL_PX[1], 355], [0, 0, 1]])
    return CalibratedLens(K, np.zeros(5), np.c_[axis_angle_to_matrix(np.array(turn)), [0, 0, 0.6]])


LENSES = [lens([0.1, -0.6, 0.2]), lens([-0.2, 0.7, 0.3])]
MATRICES = np.stack([lens.world2cam for lens in LENSES])


@pytest.fixture
def hand():
    """Points [T, 21, 3], m, of a hand with a rigid palm that turns and bends its fingers about their own axes."""
    rng = np.random.default_rng(0)
    points = np.zeros((FRAMES, 21, 3))
    for chain, spread, lengths in zip(CHAINS, [-0.8, -0.25, 0, 0.2, 0.4], LENGTHS_M, strict=True):
        curl = np.c_[np.zeros(FRAMES), rng.uniform(0.1, 1.1, (FRAMES, 3)).cumsum(1)]
        flat = np.cos(curl)
        bones = np.stack([flat * np.sin(spread), flat * np.cos(spread), -np.sin(curl)], -1) * lengths[:, None]
        points[:, chain[1:]] = bones.cumsum(1)
    turns = axis_angle_to_matrix(rng.uniform(-0.5, 0.5, (FRAMES, 3)))
    return (points - [0, 0.09, 0]) @ turns.swapaxes(1, 2)


def shown(points):
    """Where both cameras show points: [T, 2, 21, 2] at depth 1."""
    return projected(MATRICES, points[:, None])[0]


def triangulated_plainly(flat):
    return triangulated(np.broadcast_to(MATRICES, (len(flat), 2, 3, 4)), flat, np.ones(flat.shape[:-1]))


def lengths_mm(points):
    return 1000 * np.linalg.norm(np.diff(points[:, CHAINS], axis=2), axis=-1)


def off_mm(points, hand):
    return 1000 * np.linalg.norm(points - hand, axis=-1)


@pytest.fixture
def noisy(hand):
    return shown(hand) + np.random.default_rng(1).normal(0, 3, (FRAMES, 2, 21, 2)) / FOCAL_PX


def test_bones_keep_their_lengths_and_points_come_nearer(hand, noisy):
    plain = triangulated_plainly(noisy)
    found = with_constant_bones(plain, noisy, LENSES)
    assert lengths_mm(plain).std(0).min() > 1.8
    assert lengths_mm(found).std(0).max() < 0.5
    np.testing.assert_allclose(lengths_mm(found).mean(0), 1000 * LENGTHS_M, atol=1.2)
    assert off_mm(found, hand).mean() < 0.85 * off_mm(plain, hand).mean()


def test_a_finger_that_both_pictures_show_too_long_does_not_swing(hand):
    pulled = hand.copy()
    along = hand[20, 11] - hand[20, 9]
    pulled[20, 11:13] += 0.02 * along / np.linalg.norm(along)
    flat = shown(pulled)
    found = with_constant_bones(triangulated_plainly(flat), flat, LENSES)
    assert (lengths_mm(pulled)[20] - 1000 * LENGTHS_M).max() > 15
    assert (lengths_mm(found)[20] - 1000 * LENGTHS_M).max() < 3


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("direction", [(0, 1), (-0.6, 0.8)])
def test_a_point_that_is_far_off_in_one_picture_comes_back(hand, camera, direction):
    """Not where it moves along x: on the other camera's line of sight, both pictures agree on a wrong point."""
    flat = shown(hand)
    flat[20, camera, 7] += 40 * np.array(direction) / FOCAL_PX
    plain = triangulated_plainly(flat)
    found = with_constant_bones(plain, flat, LENSES)
    assert off_mm(plain, hand)[20, 7] > 12
    assert off_mm(found, hand)[20, 7] < 2.5
    assert np.delete(off_mm(found, hand), 20, 0).max() < 0.001


def test_exact_points_stay(hand):
    np.testing.assert_allclose(with_constant_bones(hand, shown(hand), LENSES), hand, rtol=0, atol=1e-6)


def test_films_of_other_frames_and_a_world_of_another_unit_tell_metres(hand):
    pytest.importorskip("cv2")
    still = np.repeat(hand[:1], 6, 0)
    found = [
        (flat * FOCAL_PX + [350, 355], np.arange(6) + first)
        for flat, first in zip(shown(still).swapaxes(0, 1), (3, 5), strict=True)
    ]
    inches = [each._replace(world2cam=each.world2cam * [1, 1, 1, 1 / 0.0254]) for each in LENSES]
    truth = stereo_truth(found, inches, Path3D(still[:2], np.arange(2)))
    for path in truth:
        assert path.frames.tolist() == [5, 6, 7, 8]
        np.testing.assert_allclose(path.points, still[:4], rtol=0, atol=1e-6)


def test_both_paths_are_smoothed_and_one_has_constant_bones(hand, noisy):
    pytest.importorskip("cv2")
    still = np.repeat(hand[:1], FRAMES, 0)
    flat = noisy - shown(hand) + shown(still)
    found = [(flat[:, camera] * FOCAL_PX + [350, 355], np.arange(FRAMES)) for camera in (0, 1)]
    truth = plain, constant = stereo_truth(found, LENSES, Path3D(still, np.arange(FRAMES)))
    assert max(off_mm(path.points, still).mean() for path in truth) < 1.5  # 2.8 without smoothing
    assert lengths_mm(plain.points).std(0).mean() > 0.8
    assert lengths_mm(constant.points).std(0).mean() < 0.25


def test_a_lens_without_distortion_only_scales():
    pytest.importorskip("cv2")
    flat = np.random.default_rng(1).uniform(-0.3, 0.3, (2, 5, 2))
    np.testing.assert_allclose(straightened(flat * FOCAL_PX + [350, 355], LENSES[0]), flat, atol=1e-9)
