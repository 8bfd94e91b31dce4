"""Finger controls: the rotations they add, before the bones' own, and that nothing else moves."""

import math
from dataclasses import replace

import bpy
import livehand
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import FINGERS, bone_name, finger_joints, master_name
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.controls import CONTROLS
from livehand.livehand_blender.rig.fingertips import move_targets_to_fingertips
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands
from livehand.livehand_blender.rig.keyframes import keyframe_theta
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose, write_theta
from livehand.livehand_blender.rig.sliders import slider_path, write_slider


def read(hand):
    hand.update_tag()
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def theta_of_controls(values, side):
    """Sum of the controls' gestures in the table."""
    angles = sum(value * CONTROLS[path].angles_deg() for path, value in values.items())
    theta = theta_of(angles, FingerAxes.of_default_hand())
    return theta if side == "right" else theta * MIRROR_AXIS_ANGLE


@pytest.mark.parametrize("path", CONTROLS)
def test_a_control_is_its_gesture_scaled(hand, model, path):
    for value in (-0.2, 0.7):
        write_slider(hand, path, value)
        np.testing.assert_allclose(read(hand).theta, theta_of_controls({path: value}, model.side), atol=2e-6)


def test_controls_sum_and_come_before_the_bones_own_rotation(
    hand, model, random_pose, evaluated_vertices, backend_vertices
):
    pose = random_pose(0, model.side)
    write_hand_pose(RiggedHand.of(hand), pose)
    values = {"fist": 0.3, "index.curl": 0.2, "ring.spread": -0.4, "opposition": 0.5, "thumb.curl": 0.1}
    for path, value in values.items():
        write_slider(hand, path, value)
    both = read(hand)
    wanted = axis_angle_to_matrix(theta_of_controls(values, model.side)) @ axis_angle_to_matrix(pose.theta)
    np.testing.assert_allclose(axis_angle_to_matrix(both.theta), wanted, atol=2e-6)
    assert np.abs(evaluated_vertices(hand) - backend_vertices(model, both)).max() <= 1e-5


@pytest.mark.parametrize("finger", FINGERS)
def test_a_master_bone_curls_and_spreads_its_finger(hand, model, finger):
    master = hand.pose.bones[master_name(finger, model.side)]
    master.rotation_euler.x = math.radians(45)
    by_master = read(hand).theta
    farthest = np.abs(CONTROLS[f"{finger}.curl"].angles_deg()).max()
    np.testing.assert_allclose(by_master, theta_of_controls({f"{finger}.curl": 45 / farthest}, model.side), atol=2e-6)
    master.rotation_euler = (0, 0, math.radians(6))
    turned = read(hand).theta
    share = 6 / np.abs(CONTROLS[f"{finger}.spread"].angles_deg()).max()
    both = [theta_of_controls({f"{finger}.spread": sign * share}, model.side) for sign in (-1, 1)]
    assert min(np.abs(turned - one).max() for one in both) < 2e-6
    if finger != "thumb":  # the finger turns the way the bone does
        axis = np.array(master.bone.matrix_local.to_3x3()) @ (0, 0, 1)
        assert turned[finger_joints(finger)[0]] @ axis == pytest.approx(math.radians(6), abs=0.02)


def test_master_bones_follow_the_wrist(hand, model):
    """They stay over their fingers' first joints, and read the same turns."""
    fingers = [(master_name(finger, model.side), bone_name(finger_joints(finger)[0], model.side)) for finger in FINGERS]
    hand.pose.bones[master_name("index", model.side)].rotation_euler.x = 0.5
    before = read(hand).theta
    RiggedHand.of(hand).bone(0).rotation_quaternion = (0.8, 0.1, -0.3, 0.5)
    after = read(hand).theta
    np.testing.assert_allclose(after[1:], before[1:], atol=2e-6)
    bones = hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    for master, first in fingers:
        assert (bones[master].head - bones[first].head).length < 1e-6
    assert (bones[fingers[0][0]].head - bones[fingers[0][0]].bone.head_local).length > 0.01


def test_master_bones_play_without_the_add_on(hand, model):
    finger, suffix = bone_name(finger_joints("index")[1], model.side), model.side[0].upper()
    livehand.unregister()
    try:
        hand.pose.bones[f"CTL-index.{suffix}"].rotation_euler.x = 1.0
        hand.update_tag()
        bone = hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones[finger]
        bent = bone.matrix.to_quaternion().rotation_difference(bone.bone.matrix_local.to_quaternion()).angle
    finally:
        livehand.register()
    assert bent > 1.5  # both joints up to it


def test_writing_a_pose_resets_the_master_bones(hand, model, random_pose):
    hand.pose.bones[master_name("ring", model.side)].rotation_euler.x = 0.5
    pose = random_pose(1, model.side)
    write_theta(RiggedHand.of(hand), pose.theta)
    assert np.abs(axis_angle_to_matrix(read(hand).theta) - axis_angle_to_matrix(pose.theta)).max() < 1e-5


def test_controls_can_be_keyed(hand, model):
    for frame, value in ((1, 0.0), (11, 1.0)):
        write_slider(hand, "index.curl", value)
        hand.keyframe_insert(slider_path("index.curl"), frame=frame)
    bpy.context.scene.frame_set(11)
    np.testing.assert_allclose(read(hand).theta, theta_of_controls({"index.curl": 1}, model.side), atol=2e-6)
    bpy.context.scene.frame_set(1)
    np.testing.assert_allclose(read(hand).theta, 0, atol=1e-6)


@pytest.mark.parametrize("write", [write_theta, lambda hand, theta: keyframe_theta(hand, theta[None], [1])])
def test_writing_a_pose_resets_the_controls(hand, random_pose, model, write):
    write_slider(hand, "fist", 0.5)
    write_slider(hand, "thumb.spread", 0.5)
    write_slider(hand, "ring.ik", 1.0)
    pose = random_pose(1, model.side)
    write(RiggedHand.of(hand), pose.theta)
    assert np.abs(axis_angle_to_matrix(read(hand).theta) - axis_angle_to_matrix(pose.theta)).max() < 1e-5


def test_the_controls_of_another_model_bend_about_its_bones():
    """Only the built-in hand has anatomical axes of its own."""
    hand = add_hand(bpy.context, replace(load_default_hand(), sha256="0" * 64))
    write_slider(hand, "thumb.curl", 0.5)
    by_control = read(hand).theta
    write_slider(hand, "thumb.curl", 0.0)
    for joint, flexion_deg in zip(finger_joints("thumb"), CONTROLS["thumb.curl"].thumb, strict=True):
        half = math.radians(flexion_deg[0]) / 4
        hand.pose.bones[bone_name(joint, "right")].rotation_quaternion = (math.cos(half), math.sin(half), 0, 0)
    np.testing.assert_allclose(read(hand).theta, by_control, atol=2e-6)


def test_a_linked_hand_can_be_controlled_through_an_override(hand, model, tmp_path):
    path, shot = str(tmp_path / "hand.blend"), str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["LiveHand"]
    bpy.context.collection.objects.link(wanted.objects[0])
    view_layer = bpy.context.view_layer
    view_layer.update()
    hand = wanted.objects[0].override_hierarchy_create(bpy.context.scene, view_layer, do_fully_editable=True)
    write_slider(hand, "ring.curl", 0.4)
    write_slider(hand, "opposition", 0.3)
    wanted_theta = theta_of_controls({"ring.curl": 0.4, "opposition": 0.3}, model.side)
    np.testing.assert_allclose(read(hand).theta, wanted_theta, atol=2e-6)
    move_targets_to_fingertips(bpy.context, RiggedHand.of(hand), ["thumb"])
    np.testing.assert_allclose(read(hand).theta, wanted_theta, atol=1e-4)
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    bpy.ops.wm.open_mainfile(filepath=shot)
    (hand,) = [thing for thing in find_hands(bpy.context.scene) if thing.override_library]
    np.testing.assert_allclose(read(hand).theta, wanted_theta, atol=1e-4)


def test_every_finger_has_its_controls():
    assert {f"{finger}.{name}" for finger in FINGERS for name in ("curl", "spread")} < CONTROLS.keys()


def test_a_resting_hand_has_no_control_set(hand, model):
    np.testing.assert_allclose(read(hand).theta, HandPose.rest(model.side).theta, atol=1e-6)
