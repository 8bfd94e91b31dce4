"""Fingertip IK: snapping between bones and targets keeps the pose, and fingertips reach their targets."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.bones import FINGERS, bone_name, finger_joints, target_name
from livehand.backend.hand.gestures import FingerAxes, sample_angles_deg, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.fingertips import move_bones_to_ik, move_targets_to_fingertips
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose
from livehand.livehand_blender.rig.sliders import write_slider

MOST_DEG = 0.5


def read(hand):
    hand.update_tag()
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def apart_deg(pose, other):
    """Largest angle between two poses' joint rotations."""
    between = axis_angle_to_matrix(pose.theta).swapaxes(1, 2) @ axis_angle_to_matrix(other.theta)
    return np.rad2deg(np.linalg.norm(matrix_to_axis_angle(between), axis=-1).max())


def natural_pose(seed, side):
    """A natural pose with a random shape and translation."""
    rng = np.random.default_rng(seed)
    theta = theta_of(sample_angles_deg(rng, 1)[0], FingerAxes.of_default_hand(), rng.normal(size=3) * 0.5)
    theta = theta if side == "right" else theta * MIRROR_AXIS_ANGLE
    return HandPose(theta, rng.normal(size=10), rng.normal(size=3) * 0.1, side)


def drag(hand, rng, reach_m):
    for finger in FINGERS:
        target = hand.pose.bones[target_name(finger, hand.livehand.side)]
        target.location = np.array(target.location) + rng.normal(size=3) * reach_m


@pytest.mark.parametrize("seed", range(6))
def test_fk_to_ik_and_back_restores_every_bone(hand, model, seed):
    write_hand_pose(RiggedHand.of(hand), natural_pose(seed, model.side))
    write_slider(hand, "fist", 0.1 * seed)
    write_slider(hand, "index.spread", 0.2)
    before = read(hand)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    assert [hand[f"{finger}.ik"] for finger in FINGERS] == [1] * 5
    assert apart_deg(read(hand), before) < MOST_DEG
    move_bones_to_ik(bpy.context, RiggedHand.of(hand), FINGERS)
    assert [hand[f"{finger}.ik"] for finger in FINGERS] == [0] * 5
    assert apart_deg(read(hand), before) < MOST_DEG


@pytest.mark.parametrize("seed", range(6))
def test_ik_to_fk_and_back_keeps_the_pose(hand, model, seed, evaluated_vertices, backend_vertices):
    write_hand_pose(RiggedHand.of(hand), natural_pose(seed, model.side))
    write_slider(hand, "middle.curl", 0.1)
    before = read(hand)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    drag(hand, np.random.default_rng(seed), 0.006)
    by_targets = read(hand)
    assert apart_deg(by_targets, before) > 5
    assert np.abs(evaluated_vertices(hand) - backend_vertices(model, by_targets)).max() <= 1e-5
    move_bones_to_ik(bpy.context, RiggedHand.of(hand), FINGERS)
    assert apart_deg(read(hand), by_targets) < MOST_DEG
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    assert apart_deg(read(hand), by_targets) < MOST_DEG


def test_targets_move_to_the_fingertips_of_the_fk_pose(hand, model):
    write_slider(hand, "fist", 0.3)
    before = read(hand)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    drag(hand, np.random.default_rng(0), 0.006)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    assert apart_deg(read(hand), before) < MOST_DEG


def test_fingertips_reach_their_targets_while_the_wrist_turns(hand, model):
    """From a half-closed hand, so that every finger can reach its target."""
    write_slider(hand, "fist", 0.4)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    wrist = hand.pose.bones[bone_name(0, model.side)]
    wrist.rotation_quaternion, wrist.location = (1, 0.04, 0.0, 0.04), (0.002, 0.004, -0.003)
    bpy.context.view_layer.update()
    bones = hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    for finger in FINGERS:
        tip = bones[bone_name(finger_joints(finger)[-1], model.side)].tail
        assert (tip - bones[target_name(finger, model.side)].head).length < 5e-4, finger


def test_targets_move_with_a_wrist_that_depends_on_the_shape():
    """MANO's wrist moves with the shape; the built-in hand's does not."""
    rng = np.random.default_rng(0)
    plain = load_default_hand()
    model = replace(plain, shapedirs=plain.shapedirs + rng.normal(size=plain.shapedirs.shape) * 1e-3)
    model = replace(model, shapedirs=model.shapedirs + rng.normal(size=(1, 3, 10)) * 5e-3)
    hand = add_hand(bpy.context, model)
    write_hand_pose(RiggedHand.of(hand), natural_pose(3, "right"))
    before = read(hand)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), FINGERS)
    assert apart_deg(read(hand), before) < MOST_DEG


def test_the_ik_slider_blends_and_affects_only_its_own_finger(hand, model):
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), ["index"])
    target = hand.pose.bones[target_name("index", model.side)]
    target.location = np.array(target.bone.matrix_local.to_3x3()).T @ (0.03, -0.03, 0)
    angles = []
    for share in (0.0, 0.5, 1.0):
        write_slider(hand, "index.ik", share)
        theta = read(hand).theta
        np.testing.assert_allclose(np.delete(theta, finger_joints("index"), axis=0), 0, atol=1e-6)
        angles.append(np.linalg.norm(theta))
    assert angles[0] < 1e-6 < 0.1 < angles[1] < angles[2]
