"""Errors of poses, against turns and lengths that are known."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.records.shot import HandPose
from livehand.backend.research.pose_errors import pose_errors

HAND = load_default_hand()
FLAT = HandPose(np.zeros((16, 3)), np.zeros(10), np.array([0.1, 0, 0]), "right")


def turned(joint, angle_deg):
    theta = np.zeros((16, 3))
    theta[joint, 1] = np.deg2rad(angle_deg)
    return replace(FLAT, theta=theta)


def test_a_pose_has_no_errors_against_itself_wherever_it_is():
    away = replace(turned(5, 30), transl=np.array([1.0, 2, 3]))
    assert pose_errors(HAND, [away], [turned(5, 30)]) == pytest.approx((0, 0, 0), abs=1e-4)


def test_a_finger_that_is_off_is_a_fifteenth_of_the_mean_angle():
    found = pose_errors(HAND, [turned(5, 42), FLAT], [turned(5, 30), FLAT])
    assert found[:2] == pytest.approx((12 / 15 / 2, 0), abs=1e-4)
    assert found.tips_mm > 0.1


def test_the_wrist_moves_all_tips_by_their_own_chords():
    points = landmarks_of(HAND, FLAT)
    arms = np.linalg.norm((points - points[0])[[4, 8, 12, 16, 20]][:, [0, 2]], axis=1)  # from the axis of the turn
    found = pose_errors(HAND, [turned(0, 10)], [FLAT])
    assert found == pytest.approx((0, 10, 1000 * (2 * np.sin(np.deg2rad(5)) * arms).mean()), abs=1e-3)
    assert str(found).startswith("fingers 0.00 deg, wrist 10.00 deg, tips ")
