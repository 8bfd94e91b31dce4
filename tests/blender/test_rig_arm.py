"""A hand that goes on into a forearm: the forearm carries the hand, and the wrist bends against it."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import bone_name, forearm_name, rest_forearm
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import hand_channels, key_hand, keyframe_theta, keyframe_transl
from livehand.livehand_blender.rig.pose import (
    mirror_pose,
    read_hand_pose,
    write_hand_pose,
    write_theta,
    write_transl,
)
from livehand.livehand_blender.rig.sliders import write_slider
from livehand.tools.builtin_hand import TEMPLATE

TOLERANCE_M = 1e-5
MODES = ("QUATERNION", "AXIS_ANGLE", "XYZ", "ZYX")


@pytest.fixture
def arm_pose(random_pose):
    """A function: a random pose whose forearm is turned against the hand."""

    def of(seed, side):
        return replace(random_pose(seed, side), forearm=np.random.default_rng(seed + 1000).normal(size=3) * 0.8)

    return of


def read(hand):
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def farthest(a, b):
    return np.linalg.norm(a - b, axis=-1).max()


def rotations_agree(a, b):
    return np.abs(axis_angle_to_matrix(a) - axis_angle_to_matrix(b)).max() < 1e-5


def assert_same_pose(read, pose):
    assert rotations_agree(read.theta, pose.theta)
    assert rotations_agree(read.forearm, pose.forearm)
    np.testing.assert_allclose(read.transl, pose.transl, atol=1e-6)
    np.testing.assert_allclose(read.beta, pose.beta, atol=1e-6)


def test_mesh_equals_the_backend_and_the_pose_is_read_back_in_every_rotation_mode(
    armed_hand, armed_model, arm_pose, evaluated_vertices, backend_vertices
):
    worst = 0.0
    for seed in range(100):
        for bone in armed_hand.pose.bones:
            bone.rotation_mode = MODES[seed % 4]
        pose = arm_pose(seed, armed_model.side)
        write_hand_pose(RiggedHand.of(armed_hand), pose)
        worst = max(worst, farthest(evaluated_vertices(armed_hand), backend_vertices(armed_model, pose)))
        assert_same_pose(read(armed_hand), pose)
    assert worst <= TOLERANCE_M


def test_a_straight_forearm_carries_the_hand_and_the_wrist_does_not_turn(armed_hand, armed_model, random_pose):
    write_hand_pose(RiggedHand.of(armed_hand), random_pose(0, armed_model.side))
    wrist = armed_hand.pose.bones[bone_name(0, armed_model.side)]
    np.testing.assert_allclose(wrist.matrix_basis, np.eye(4), atol=1e-6)
    assert wrist.parent.name == forearm_name(armed_model.side)
    assert all(wrist.lock_location)
    assert not any(wrist.parent.lock_location)


def test_the_forearm_ends_at_the_wrist_and_is_as_long_as_the_arm(armed_hand, armed_model):
    forearm = armed_hand.data.bones[forearm_name(armed_model.side)]
    np.testing.assert_allclose(forearm.tail_local, armed_model.joints[0], atol=1e-6)
    beyond = np.abs((armed_model.v_template - armed_model.joints[0])[armed_model.arm_weights > 0][:, 0]).max()
    assert forearm.length == pytest.approx(beyond, rel=0.15)
    frame = rest_forearm(armed_model).frame
    np.testing.assert_allclose(forearm.matrix_local.to_3x3(), frame, atol=1e-6)
    assert np.linalg.det(frame) == pytest.approx(1)


def test_turning_the_wrist_bone_leaves_the_forearm_where_it_is(armed_hand, armed_model, evaluated_vertices):
    before = evaluated_vertices(armed_hand)
    armed_hand.pose.bones[bone_name(0, armed_model.side)].rotation_quaternion = (0.9, 0.3, 0.1, -0.2)
    bpy.context.view_layer.update()
    after = evaluated_vertices(armed_hand)
    only_arm = armed_model.arm_weights == 1
    assert only_arm.any()
    assert farthest(before[only_arm], after[only_arm]) < 1e-6
    assert farthest(before, after) > 0.05


def test_keyed_beta_keeps_the_forearm_at_the_shaped_wrist(
    armed_hand, armed_model, arm_pose, evaluated_vertices, backend_vertices
):
    pose = arm_pose(2, armed_model.side)
    write_hand_pose(RiggedHand.of(armed_hand), pose)
    for frame, value in ((1, -2.0), (11, 2.0)):
        write_slider(armed_hand, "beta", np.full(10, value))
        armed_hand.keyframe_insert('["beta"]', frame=frame)
    for frame, value in ((1, -2.0), (6, 0.0)):
        bpy.context.scene.frame_set(frame)
        expected = backend_vertices(armed_model, replace(pose, beta=np.full(10, value)))
        assert farthest(evaluated_vertices(armed_hand), expected) <= TOLERANCE_M


def test_theta_alone_turns_the_hand_about_its_wrist(armed_hand, armed_model, arm_pose):
    hand, pose, other = RiggedHand.of(armed_hand), arm_pose(0, armed_model.side), arm_pose(1, armed_model.side)
    write_hand_pose(hand, pose)
    write_theta(hand, other.theta, other.forearm)
    assert_same_pose(read(armed_hand), replace(other, beta=pose.beta, transl=pose.transl))


def test_keyframes_play_back_the_sequence_in_either_order(armed_hand, armed_model, arm_pose):
    hand, frames = RiggedHand.of(armed_hand), np.arange(6) + 3
    hand.forearm.rotation_mode = "XYZ"
    poses = [replace(arm_pose(seed, armed_model.side), beta=np.zeros(10)) for seed in range(6)]
    thetas, forearms, transls = (np.array([getattr(p, name) for p in poses]) for name in ("theta", "forearm", "transl"))
    keyframe_transl(hand, transls, frames)
    keyframe_theta(hand, thetas, frames, forearms=forearms)
    for frame, pose in zip(frames, poses, strict=True):
        bpy.context.scene.frame_set(int(frame))
        assert_same_pose(read(armed_hand), pose)
    keyframe_theta(hand, thetas[::-1], frames, range(1, 16))
    keyframe_transl(hand, transls[::-1], frames)
    for number, frame in enumerate(frames):
        bpy.context.scene.frame_set(int(frame))
        back = read(armed_hand)
        assert rotations_agree(back.theta[0], thetas[number, 0])
        assert rotations_agree(back.theta[1:], thetas[-1 - number, 1:])
        np.testing.assert_allclose(back.transl, transls[-1 - number], atol=1e-6)
    with pytest.raises(LiveHandError, match="forearms must be"):
        keyframe_theta(hand, thetas, frames, forearms=np.zeros((2, 3)))


def test_keying_the_hand_keys_the_forearm_and_the_wrist(armed_hand, armed_model, arm_pose):
    hand, pose = RiggedHand.of(armed_hand), arm_pose(3, armed_model.side)
    pose = replace(pose, beta=np.zeros(10))
    write_hand_pose(hand, pose)
    key_hand(hand, 1)
    write_theta(hand, np.zeros((16, 3)))
    write_transl(hand, np.zeros(3))
    key_hand(hand, 2)
    bpy.context.scene.frame_set(1)
    assert_same_pose(read(armed_hand), pose)
    paths = [path for path, _ in hand_channels(hand)]
    assert len(paths) == len(set(paths))
    assert not any("wrist" in path and "location" in path for path in paths)


def test_a_mirrored_pose_has_the_mirrored_forearm(armed_hand, armed_model, arm_pose):
    other_side = "left" if armed_model.side == "right" else "right"
    other = add_hand(bpy.context, armed_model.for_side(other_side), name="Other")
    pose = arm_pose(4, armed_model.side)
    write_hand_pose(RiggedHand.of(armed_hand), pose)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mirror_pose(RiggedHand.of(armed_hand), RiggedHand.of(other), depsgraph, turns_wrist=True)
    back = read(other)
    assert rotations_agree(back.theta, pose.mirrored().theta)
    assert rotations_agree(back.forearm, pose.mirrored().forearm)
    write_theta(RiggedHand.of(other), np.zeros((16, 3)), np.array([0.1, 0.2, 0.3]))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mirror_pose(RiggedHand.of(armed_hand), RiggedHand.of(other), depsgraph, turns_wrist=False)
    np.testing.assert_allclose(read(other).theta[0], 0, atol=1e-6)
    np.testing.assert_allclose(read(other).forearm, (0.1, 0.2, 0.3), atol=1e-5)


def test_mirrored_turns_are_blenders_flipped_pose(armed_path):
    """Paste Pose Flipped turns (w, x, y, z) into (w, x, -y, -z), and a location (x, y, z) into (-x, y, z)."""
    model, rng = load_hand_model(armed_path), np.random.default_rng(3)
    hands = [RiggedHand.of(add_hand(bpy.context, model.for_side(side))) for side in ("right", "left")]
    pose = HandPose(rng.normal(size=(16, 3)), np.zeros(10), rng.normal(size=3), forearm=rng.normal(size=3))
    for hand, own in zip(hands, (pose, pose.mirrored()), strict=True):
        write_hand_pose(hand, own)
    for bone, other in zip(hands[0].bones, hands[1].bones, strict=True):
        turned = np.array(bone.rotation_quaternion) * [1, 1, -1, -1]
        np.testing.assert_allclose(other.rotation_quaternion, turned, atol=1e-5)
    np.testing.assert_allclose(hands[1].forearm.location, np.multiply(hands[0].forearm.location, (-1, 1, 1)), atol=1e-5)


def test_resetting_returns_the_forearm_to_rest(armed_hand, armed_model, arm_pose):
    write_hand_pose(RiggedHand.of(armed_hand), replace(arm_pose(6, armed_model.side), beta=np.zeros(10)))
    assert bpy.ops.livehand.reset_pose() == {"FINISHED"}
    for bone in RiggedHand.of(armed_hand).bones:
        np.testing.assert_allclose(bone.matrix_basis, np.eye(4), atol=1e-6)


def test_the_wrist_stops_at_its_range_only_with_limited_joints(armed_hand, armed_model):
    wrist = armed_hand.pose.bones[bone_name(0, armed_model.side)]
    wrist.rotation_mode = "YZX"
    thumbwards = -1 if armed_model.side == "right" else 1  # of a turn about Z
    for limited, bend_deg, sideways_deg in ((False, 100, 50), (True, 70, 20)):
        write_slider(armed_hand, "limit_joints", limited)
        for wanted, expected in (((100, 0, 0), (bend_deg, 0, 0)), ((0, 0, 50 * thumbwards), (0, 0, sideways_deg))):
            wrist.rotation_euler = np.deg2rad(wanted)
            armed_hand.update_tag()
            frame = np.array(wrist.bone.matrix_local.to_3x3())
            turned = np.rad2deg(frame.T @ -read(armed_hand).forearm)
            np.testing.assert_allclose(turned, np.multiply(expected, (1, 1, thumbwards)), atol=1e-3)


def test_a_lost_forearm_is_named(armed_hand, armed_model):
    name = forearm_name(armed_model.side)
    armed_hand.data.bones[name].name = "arm"
    with pytest.raises(LiveHandError, match=f"missing: {name}"):
        RiggedHand.of(armed_hand)


def test_a_hand_without_an_arm_has_no_forearm_and_ignores_that_of_a_pose(model, arm_pose, evaluated_vertices):
    hand = add_hand(bpy.context, load_hand_model(TEMPLATE).for_side(model.side), str(TEMPLATE))
    assert len(hand.data.bones) == 1 + 2 * 16 + 15 + 5 + 5 + 5
    rigged, pose = RiggedHand.of(hand), arm_pose(5, model.side)
    assert rigged.forearm is None
    write_hand_pose(rigged, replace(pose, forearm=np.zeros(3)))
    straight = evaluated_vertices(hand)
    write_hand_pose(rigged, pose)
    np.testing.assert_array_equal(evaluated_vertices(hand), straight)
    np.testing.assert_array_equal(read(hand).forearm, 0)
