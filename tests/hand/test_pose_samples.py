"""Random poses: repeatable, with the library's among them; relieved, they hardly cross."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.penetration import HandParts, relieved_angles
from livehand.backend.hand.poses import LIBRARY_SHARE, POSES, sample_poses_deg
from livehand.backend.records.shot import HandPose


def test_one_seed_gives_the_same_poses():
    one, again, other = (sample_poses_deg(np.random.default_rng(seed), 40) for seed in (5, 5, 6))
    np.testing.assert_array_equal(again, one)
    assert (one != other).any()


def test_a_share_is_near_a_pose_of_the_library():
    library = np.stack([pose.gesture.angles_deg() for pose in POSES.values()])
    sampled = sample_poses_deg(np.random.default_rng(5), 200)
    distance_deg = np.abs(sampled[:, None] - library).mean((2, 3)).min(1)
    assert (distance_deg < 2.5).mean() > 0.8 * LIBRARY_SHARE
    assert (distance_deg > 4).mean() > 0.1


@pytest.mark.slow
def test_relieved_they_hardly_cross(hand):
    axes, parts = FingerAxes.of_default_hand(), HandParts(hand)
    deepest_mm = []
    for angles in sample_poses_deg(np.random.default_rng(5), 24):
        theta = theta_of(relieved_angles(parts, hand, angles, axes), axes)
        contacts = parts.contacts(posed_vertices(hand, HandPose(theta, np.zeros(10), np.zeros(3))))
        deepest_mm.append(1000 * contacts.deepest_m)
    assert np.mean(np.array(deepest_mm) > 1.0) < 0.1
    assert max(deepest_mm) < 5
    assert np.mean(np.array(deepest_mm) > 0.05) > 0.05  # some touch
