"""Joint limits: the angles at which they stop a joint, and that they are off by default."""

import math

import bpy
import mathutils
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import bone_name, rest_flexion_deg, target_name
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.livehand_blender.rig.build import joint_limits_rad
from livehand.livehand_blender.rig.fingertips import move_targets_to_fingertips
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_theta
from livehand.livehand_blender.rig.sliders import write_slider


def read(hand):
    hand.update_tag()
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta


def flexion_deg(hand, joint, side):
    """A joint's rotation about its bone's X; there must be no other rotation."""
    frame = np.array(hand.data.bones[bone_name(joint, side)].matrix_local.to_3x3())
    turned = np.rad2deg(frame.T @ read(hand)[joint])
    np.testing.assert_allclose(turned[1:], 0, atol=1e-3)
    return turned[0]


@pytest.mark.parametrize(("joint", "straight_range"), [(1, (-45, 90)), (2, (0, 100)), (3, (-10, 90)), (8, (0, 100))])
def test_a_joint_stops_at_the_published_angle_from_the_straight_finger(hand, model, joint, straight_range):
    bent = rest_flexion_deg(model)[joint - 1]
    for angle_deg, stop in zip((-100, 130), straight_range, strict=True):
        half = math.radians(angle_deg) / 2
        hand.pose.bones[bone_name(joint, model.side)].rotation_quaternion = (math.cos(half), math.sin(half), 0, 0)
        write_slider(hand, "limit_joints", False)
        assert flexion_deg(hand, joint, model.side) == pytest.approx(angle_deg, abs=1e-3)
        write_slider(hand, "limit_joints", True)
        assert flexion_deg(hand, joint, model.side) == pytest.approx(stop - bent, abs=1e-3)


def test_both_hands_have_mirrored_ranges(model):
    low, high = np.swapaxes(joint_limits_rad(model), 0, 1)
    other_low, other_high = np.swapaxes(joint_limits_rad(model.for_side("right")), 0, 1)
    sign = np.array([1, 1, 1] if model.side == "right" else [1, -1, -1])
    np.testing.assert_allclose(low, np.minimum(other_low * sign, other_high * sign))
    np.testing.assert_allclose(high, np.maximum(other_low * sign, other_high * sign))


@pytest.mark.parametrize("gesture", ["open", "relaxed", "pinch", "point"])
def test_gestures_lie_within_the_limits(hand, model, gesture):
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand())
    theta = theta if model.side == "right" else theta * MIRROR_AXIS_ANGLE
    write_theta(RiggedHand.of(hand), theta)
    write_slider(hand, "limit_joints", True)
    assert np.rad2deg(np.abs(read(hand) - theta).max()) < 6


def test_limits_stop_an_excessive_fist_control(hand, model):
    write_slider(hand, "limit_joints", True)
    write_slider(hand, "fist", 2.0)
    assert np.rad2deg(np.linalg.norm(read(hand)[1:13], axis=1)).max() < 100


def test_a_fingertip_target_bends_no_joint_past_its_range(hand, model):
    """The target pulls the thumb's tip towards the wrist, where an unlimited saddle joint would rotate too far."""
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), ["thumb"])
    target = hand.pose.bones[target_name("thumb", model.side)]
    towards_wrist = 0.06 if model.side == "right" else -0.06
    target.location = np.array(target.bone.matrix_local.to_3x3()).T @ (towards_wrist, -0.02, 0)
    least = joint_limits_rad(model)[12, 0, 0]
    assert saddle_flexion_rad(hand, model.side) < least - 0.05
    write_slider(hand, "limit_joints", True)
    assert saddle_flexion_rad(hand, model.side) > least - 0.02


def saddle_flexion_rad(hand, side):
    frame = hand.data.bones[bone_name(13, side)].matrix_local.to_3x3()
    turned = mathutils.Matrix(axis_angle_to_matrix(read(hand)[13]).tolist())
    return (frame.transposed() @ turned @ frame).to_euler("YZX").x
