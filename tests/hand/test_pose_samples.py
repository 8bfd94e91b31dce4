"""Random poses: repeatable, with the library's among them, and hardly any crossing."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.penetration import HandParts
from livehand.backend.hand.pose_samples import LIBRARY_SHARE, sample_poses_deg
from livehand.backend.hand.poses import POSES
from livehand.backend.records.shot import HandPose

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def axes():
    return FingerAxes.of_default_hand()


@pytest.fixture(scope="module")
def sampled(hand, axes):
    return sample_poses_deg(np.random.default_rng(5), 30, hand, axes)


def test_one_seed_gives_the_same_poses(hand, axes):
    one, again, other = (sample_poses_deg(np.random.default_rng(seed), 3, hand, axes) for seed in (5, 5, 6))
    np.testing.assert_array_equal(again, one)
    assert (one != other).any()


def test_a_share_is_near_a_pose_of_the_library(sampled):
    library = np.stack([pose.gesture.angles_deg() for pose in POSES.values()])
    distance_deg = np.abs(sampled[:, None] - library).mean((2, 3)).min(1)
    assert 0.5 * LIBRARY_SHARE < (distance_deg < 2.5).mean() < 2 * LIBRARY_SHARE


def test_parts_hardly_cross(hand, axes, sampled):
    parts = HandParts(hand)
    deepest_mm = [
        1000 * parts.contacts(posed_vertices(hand, HandPose(theta_of(one, axes), np.zeros(10), np.zeros(3)))).deepest_m
        for one in sampled
    ]
    assert np.mean(np.array(deepest_mm) > 1.0) < 0.1
    assert max(deepest_mm) < 5
    assert np.mean(np.array(deepest_mm) > 0.05) > 0.05  # some touch
