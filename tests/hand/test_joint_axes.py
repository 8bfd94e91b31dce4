"""Anatomical frames of the joints, and the angles of gestures in them."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import rest_bones
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.joint_axes import euler_rad, finger_axes, joint_frames
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_hand_model


def test_the_built_in_hands_frames_are_its_anatomical_axes(hand):
    axes, own = FingerAxes.of_default_hand(), finger_axes(hand)
    for name in ("flexion", "dorsal", "bone"):
        np.testing.assert_array_equal(getattr(own, name)[1:], getattr(axes, name)[1:])


def test_the_hand_with_an_arm_has_the_same_frames(hand):
    """So a gesture is the same pose of both."""
    np.testing.assert_array_equal(joint_frames(load_hand_model("hand_with_arm"))[1:], joint_frames(hand)[1:])


def test_another_hands_frames_are_its_bones(hand):
    other = replace(hand, sha256="0" * 64)
    np.testing.assert_array_equal(joint_frames(other), rest_bones(other).frames)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("gesture", ["fist", "pinch"])
def test_euler_angles_in_the_frames_give_the_gestures_rotations(hand, side, gesture):
    angles_deg = GESTURES[gesture].angles_deg()
    theta = theta_of(angles_deg, FingerAxes.of_default_hand()) * (1 if side == "right" else MIRROR_AXIS_ANGLE)
    x, y, z = (axis_angle_to_matrix(euler_rad(angles_deg, side)[:, [k]] * np.eye(3)[k]) for k in range(3))
    frames = joint_frames(hand.for_side(side))[1:]
    rotations = frames @ (x @ z @ y) @ frames.swapaxes(1, 2)
    np.testing.assert_allclose(rotations, axis_angle_to_matrix(theta[1:]), atol=1e-9)
