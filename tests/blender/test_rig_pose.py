import math

import bpy
import numpy as np
import pytest
from livehand.backend.hand.bones import bone_name, rest_bones
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig import pose as rig_pose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta, keyframe_transl
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose, write_theta

MODES = ("QUATERNION", "AXIS_ANGLE", "XYZ", "ZYX")


def read(hand):
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def random_theta(rng, frames=None, largest=3.0):
    """Axis-angles of at most `largest` rad: longer ones are read back as their shorter equivalents."""
    shape = (16, 3) if frames is None else (frames, 16, 3)
    axes = rng.normal(size=shape)
    return axes / np.linalg.norm(axes, axis=-1, keepdims=True) * rng.uniform(0, largest, (*shape[:-1], 1))


@pytest.mark.parametrize("mode", MODES)
def test_a_written_pose_is_read_back(hand, model, mode):
    for bone in hand.pose.bones:
        bone.rotation_mode = mode
    rng = np.random.default_rng(0)
    for _ in range(10):
        pose = HandPose(random_theta(rng), rng.normal(size=10), rng.normal(size=3), model.side)
        write_hand_pose(RiggedHand.of(hand), pose)
        back = read(hand)
        assert back.side == model.side
        np.testing.assert_allclose(back.theta, pose.theta, atol=1e-5)
        np.testing.assert_allclose(back.beta, pose.beta, atol=1e-6)
        np.testing.assert_allclose(back.transl, pose.transl, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, math.pi - 1e-3])
def test_round_trip_at_small_and_at_largest_angles(hand, angle):
    theta = np.tile([0.0, 0.6 * angle, 0.8 * angle], (16, 1))
    write_theta(RiggedHand.of(hand), theta)
    np.testing.assert_allclose(read(hand).theta, theta, atol=1e-5)


def test_a_half_turn_is_read_back(hand):
    write_theta(RiggedHand.of(hand), np.tile([0.0, 0.0, math.pi], (16, 1)))
    np.testing.assert_allclose(np.abs(read(hand).theta), np.tile([0, 0, math.pi], (16, 1)), atol=1e-4)


def test_rotation_about_x_closes_the_finger(hand, model):
    """For the animator: rotation about +X on any finger bone moves its tip towards the palm."""
    palmar = rest_bones(model).frames[0][:, 2]
    for joint in range(1, 13):
        bone = hand.pose.bones[bone_name(joint, model.side)]
        bpy.context.view_layer.update()
        before = bone.tail.copy()
        bone.rotation_quaternion = (math.cos(0.25), math.sin(0.25), 0, 0)
        bpy.context.view_layer.update()
        assert np.array(bone.tail - before) @ palmar > 0.2 * bone.length
        bone.rotation_quaternion = (1, 0, 0, 0)


def test_mirrored_theta_is_blenders_flipped_pose():
    """Paste Pose Flipped turns (w, x, y, z) into (w, x, -y, -z)."""
    right = add_hand(bpy.context, load_default_hand())
    left = add_hand(bpy.context, load_default_hand().for_side("left"))
    theta = random_theta(np.random.default_rng(1))
    turned = rig_pose.bone_quaternions(RiggedHand.of(right), theta)
    mirrored = rig_pose.bone_quaternions(RiggedHand.of(left), theta * MIRROR_AXIS_ANGLE)
    np.testing.assert_allclose(mirrored, turned * [1, 1, -1, -1], atol=1e-5)


def test_constraints_count_in_theta_and_in_the_mesh(hand, model, evaluated_vertices, backend_vertices):
    write_theta(RiggedHand.of(hand), random_theta(np.random.default_rng(3), largest=1.5))
    free = read(hand)
    constraint = hand.pose.bones[bone_name(5, model.side)].constraints.new("COPY_ROTATION")
    constraint.target, constraint.subtarget = hand, bone_name(1, model.side)
    constraint.owner_space = constraint.target_space = "LOCAL"
    bpy.context.view_layer.update()
    held = read(hand)
    assert np.abs(held.theta[5] - free.theta[5]).max() > 0.1
    assert np.linalg.norm(evaluated_vertices(hand) - backend_vertices(model, held), axis=1).max() <= 1e-5


def test_scaling_the_object_or_a_bone_does_not_change_theta(hand, model):
    theta = random_theta(np.random.default_rng(4))
    write_theta(RiggedHand.of(hand), theta)
    hand.scale, hand.location, hand.rotation_euler = (2, 2, 2), (1, 2, 3), (1, 1, 1)
    hand.pose.bones[bone_name(0, model.side)].scale = (1.5,) * 3
    bpy.context.view_layer.update()
    np.testing.assert_allclose(read(hand).theta, theta, atol=1e-5)


def test_an_evaluated_armature_can_be_read(hand):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    np.testing.assert_array_equal(read_hand_pose(hand.evaluated_get(depsgraph), depsgraph).theta, read(hand).theta)


def test_nan_in_a_channel_is_an_error(hand, model):
    hand.pose.bones[bone_name(2, model.side)].rotation_quaternion = (math.nan, 0, 0, 0)
    bpy.context.view_layer.update()
    with pytest.raises(LiveHandError, match="finite"):
        read(hand)


def test_other_objects_and_renamed_bones_are_rejected(hand, model):
    other = bpy.data.objects.new("Cube", None)
    with pytest.raises(LiveHandError, match="Cube is not a LiveHand hand"):
        read_hand_pose(other, bpy.context.evaluated_depsgraph_get())
    hand.data.bones[bone_name(3, model.side)].name = "renamed"
    with pytest.raises(LiveHandError, match=r"missing: index3"):
        read(hand)


def test_a_pose_for_the_other_side_is_rejected(hand, model):
    other = "left" if model.side == "right" else "right"
    with pytest.raises(LiveHandError, match="mirror"):
        write_hand_pose(RiggedHand.of(hand), HandPose.rest(other))


def test_keyframes_play_back_the_sequence(hand):
    rng = np.random.default_rng(5)
    thetas, transls = random_theta(rng, frames=20), rng.normal(size=(20, 3))
    frames = np.arange(20) + 5
    keyframe_theta(RiggedHand.of(hand), thetas, frames)
    keyframe_transl(RiggedHand.of(hand), transls, frames)
    for frame, theta, transl in zip(frames, thetas, transls, strict=True):
        bpy.context.scene.frame_set(int(frame))
        np.testing.assert_allclose(read(hand).theta, theta, atol=1e-5)
        # Both bones that carry the hand round some 2 m to single precision.
        np.testing.assert_allclose(read(hand).transl, transl, rtol=8 * np.finfo(np.float32).eps, atol=1e-6)


def test_rotations_between_keys_take_the_short_way(hand):
    """From 3.0 to 3.3 rad about one axis; the second in its shorter form, whose quaternion has the other sign."""
    thetas = np.zeros((2, 16, 3))
    thetas[0, 1, 2], thetas[1, 1, 2] = 3.0, 3.3 - 2 * math.pi
    keyframe_theta(RiggedHand.of(hand), thetas, [1, 3])
    bpy.context.scene.frame_set(2)
    assert abs(read(hand).theta[1, 2]) == pytest.approx(math.pi, abs=0.02)


def test_new_keys_replace_those_between_and_keep_those_outside(hand, model):
    first, second = np.zeros((10, 16, 3)), np.full((3, 16, 3), 0.2)
    keyframe_theta(RiggedHand.of(hand), first, np.arange(10))
    path = hand.pose.bones[bone_name(1, model.side)].path_from_id("rotation_quaternion")
    curve = next(c for c in _curves(hand) if c.data_path == path and c.array_index == 0)
    for point in curve.keyframe_points:
        point.interpolation, point.handle_right_type = "CONSTANT", "FREE"
        point.handle_right = (point.co[0] + 0.25, 3.0)
    keyframe_theta(RiggedHand.of(hand), second, [4, 5, 6])
    assert [point.co[0] for point in curve.keyframe_points] == list(range(10))
    for point in (*curve.keyframe_points[:4], *curve.keyframe_points[7:]):
        assert (point.interpolation, point.handle_right_type) == ("CONSTANT", "FREE")
        assert tuple(point.handle_right) == (point.co[0] + 0.25, 3.0)
    assert {point.interpolation for point in curve.keyframe_points[4:7]} == {"BEZIER"}
    assert len(_curves(hand)) == 16 * 4 + 4 + 3  # the forearm turns with the wrist, and carries it to where it was
    bpy.context.scene.frame_set(5)
    np.testing.assert_allclose(read(hand).theta, second[1], atol=1e-5)
    bpy.context.scene.frame_set(8)
    np.testing.assert_allclose(read(hand).theta, 0, atol=1e-5)


def _curves(hand):
    action = hand.animation_data.action
    if hasattr(action, "layers"):
        return list(action.layers[0].strips[0].channelbag(hand.animation_data.action_slot).fcurves)
    return list(action.fcurves)


@pytest.mark.parametrize(
    ("thetas", "frames", "message"),
    [
        (np.zeros((2, 16, 3)), [1], r"must be \[1, 16, 3\]"),
        (np.zeros((2, 48)), [1, 2], r"must be \[2, 16, 3\]"),
        (np.full((1, 16, 3), np.nan), [1], "finite"),
        (np.zeros((2, 16, 3)), [2, 2], "increase"),
    ],
)
def test_invalid_sequences_are_rejected(hand, thetas, frames, message):
    with pytest.raises(LiveHandError, match=message):
        keyframe_theta(RiggedHand.of(hand), thetas, frames)
