"""Made takes: hands in natural limits, in the picture, the same again from the same seed."""

import numpy as np
import pytest
from livehand.backend.hand.joint_limits import FREE, LIMITS
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.motion import mirrored
from livehand.backend.research.takes import made_take, single_fingers_deg, true_landmarks

HAND = load_default_hand()


@pytest.mark.parametrize("poses", ["library", "mixes", "single"])
def test_a_take_moves_before_its_camera(poses):
    take = made_take(np.random.default_rng(3), HAND, poses, "back", frames=20)
    points = true_landmarks(take, HAND)
    px, depth = take.camera.project(points.reshape(-1, 3))
    assert (depth > 0.2).all()
    assert ((px > 0) & (px < take.camera.size_px)).all(1).mean() > 0.9
    assert np.linalg.norm(points[-1] - points[0], axis=-1).max() > 0.01
    again = made_take(np.random.default_rng(3), HAND, poses, "back", frames=20)
    np.testing.assert_array_equal(again.motion.theta, take.motion.theta)


def test_a_left_take_is_the_mirrored_right_one():
    right, left = (made_take(np.random.default_rng(1), HAND, "mixes", "palm", 4, side) for side in ("right", "left"))
    assert left.motion.side == "left"
    np.testing.assert_allclose(mirrored(left.motion).theta, right.motion.theta)


def test_single_fingers_stay_within_their_limits():
    rng = np.random.default_rng(0)
    angles = np.deg2rad(np.stack([single_fingers_deg(rng) for _ in range(200)])).reshape(200, 45)
    free = angles[:, FREE]
    assert ((free > LIMITS[:, 0]) & (free < LIMITS[:, 1]))[:, :16].all()
    assert ((free > LIMITS[:, 0] - 0.3) & (free < LIMITS[:, 1] + 0.3)).all()
    fingers = free[:, [2, 6]]  # of index and middle finger, their middle joints
    assert abs(np.corrcoef(fingers.T)[0, 1]) < 0.25
