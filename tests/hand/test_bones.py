"""Names and rest frames of the rig's bones."""

import numpy as np
import pytest
from livehand.backend.hand.bones import (
    bone_name,
    control_name,
    deform_name,
    finger_joints,
    rest_bones,
    rest_flexion_deg,
)
from livehand.backend.hand.model import MIRROR_POINT


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_resting_fingers_are_a_little_bent(hand, side):
    bent = rest_flexion_deg(hand.for_side(side))
    assert ((5 < bent[:12].reshape(4, 3)[:, :2]) & (bent[:12].reshape(4, 3)[:, :2] < 15)).all()
    np.testing.assert_allclose(bent[2:12:3], 0, atol=1e-6)


@pytest.mark.parametrize("side", ["right", "left"])
def test_rest_frames_are_right_handed_with_y_along_the_bone(hand, side):
    model = hand.for_side(side)
    heads, tails, frames = rest_bones(model)
    np.testing.assert_allclose(heads, model.joints)
    np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.tile(np.eye(3), (16, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1)
    length = np.linalg.norm(tails - heads, axis=1, keepdims=True)
    np.testing.assert_allclose(frames[..., 1], (tails - heads) / length, atol=1e-12)
    assert ((0.005 < length) & (length < 0.12)).all()


def test_the_left_hands_bones_mirror_the_right_ones(hand):
    right, left = rest_bones(hand), rest_bones(hand.for_side("left"))
    np.testing.assert_allclose(left.tails, right.tails * MIRROR_POINT, atol=1e-12)
    # The Y and Z axes are mirrored. X is negated as well, so that flexion stays positive.
    sign = np.outer(MIRROR_POINT, [-1, 1, 1])
    np.testing.assert_allclose(left.frames, right.frames * sign, atol=1e-12)


def test_names_follow_manos_joints():
    assert (bone_name(0, "left"), bone_name(1, "right")) == ("wrist.L", "index1.R")
    assert (deform_name(4, "right"), control_name(15, "left")) == ("DEF-middle1.R", "MCH-thumb3.L")
    assert finger_joints("pinky") == (7, 8, 9)
