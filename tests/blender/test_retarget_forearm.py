"""The forearm of another rig drives that of a hand with an arm, live and baked."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import bone_name, forearm_name
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose
from livehand.livehand_blender.rigs.bake import bake
from livehand.livehand_blender.rigs.follow import follow, is_following, stop_following
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton

# What is the same for both.
ONE_SIDE = pytest.mark.parametrize("model", ["right"], indirect=True)


@pytest.fixture
def moving(other_rigs, armed_hand, armed_model):
    """An animated rig with a forearm, its frames, and our hand in another place and orientation."""
    made = other_rigs.make_rigged_hand(armed_model.side)
    frames = made.animate(("rest", "fist", "point", "pinch"))
    armed_hand.location, armed_hand.rotation_euler = (0.3, -0.7, 0.2), (0.5, 1, 2)
    bpy.context.view_layer.update()
    return made, frames, armed_hand


def read(hand, frame):
    bpy.context.scene.frame_set(frame)
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def arm_of(armature, forearm, wrist):
    """The forearm's direction from the wrist, the wrist's place, and the forearm's orientation, in the world."""
    evaluated = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    bones = evaluated.pose.bones
    elbow, joint = (np.array(evaluated.matrix_world @ bones[name].head) for name in (forearm, wrist))
    turn = np.array((evaluated.matrix_world @ bones[forearm].matrix).to_quaternion().to_matrix())
    return (elbow - joint) / np.linalg.norm(elbow - joint), joint, turn


def ours_and_theirs(other_rigs, ours, made):
    own = arm_of(ours, forearm_name(made.side), bone_name(0, made.side))
    return own, arm_of(made.armature, other_rigs.FOREARM, other_rigs.JOINTS[0])


@pytest.mark.parametrize(
    ("model", "way"),
    [
        ("right", "live"),
        ("left", "baked"),
        pytest.param("left", "live", marks=pytest.mark.nightly),
        pytest.param("right", "baked", marks=pytest.mark.nightly),
    ],
    indirect=["model"],
)
def test_the_forearm_points_and_turns_as_the_sources_does(other_rigs, moving, way):
    made, frames, ours = moving
    hand, source = RiggedHand.of(ours), SourceRig(made.armature, made.joint_map)
    if way == "live":
        follow(bpy.context, hand, source)
    else:
        bake(bpy.context, hand, source, frames)
    differences = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        (along, joint, turn), (other, place, other_turn) = ours_and_theirs(other_rigs, ours, made)
        np.testing.assert_allclose(along, other, atol=2e-5)
        assert np.linalg.norm(joint - place) < 0.005
        differences.append(other_turn.T @ turn)
    np.testing.assert_allclose(differences, np.broadcast_to(differences[0], (len(frames), 3, 3)), atol=1e-4)
    bends = [np.linalg.norm(read(ours, frame).forearm) for frame in (frames[0], 6)]  # 6: the wrist turns by 0.6 rad
    assert bends[1] > bends[0] + 0.3


def test_live_baked_and_kept_poses_agree(moving):
    made, frames, ours = moving
    source = SourceRig(made.armature, made.joint_map)
    follow(bpy.context, RiggedHand.of(ours), source)
    live = [read(ours, frame) for frame in frames]
    stop_following(bpy.context, RiggedHand.of(ours))
    kept = read(ours, frames[-1])
    for name in ("theta", "transl", "forearm"):
        np.testing.assert_allclose(getattr(kept, name), getattr(live[-1], name), atol=2e-5)
    bake(bpy.context, RiggedHand.of(ours), source, frames)
    for frame, pose in zip(frames, live, strict=True):
        baked = read(ours, frame)
        for turns, others in ((baked.forearm, pose.forearm), (baked.theta, pose.theta)):
            np.testing.assert_allclose(axis_angle_to_matrix(turns), axis_angle_to_matrix(others), atol=1e-4)
        np.testing.assert_allclose(baked.transl, pose.transl, atol=1e-5)


@ONE_SIDE
def test_without_a_forearm_in_the_map_the_arm_is_straight(moving):
    made, frames, ours = moving
    source = SourceRig(made.armature, replace(made.joint_map, forearm=None))
    follow(bpy.context, RiggedHand.of(ours), source)
    for frame in (frames[0], frames[-1]):
        np.testing.assert_allclose(read(ours, frame).forearm, 0, atol=1e-5)
    stop_following(bpy.context, RiggedHand.of(ours))
    assert not is_following(ours)
    bake(bpy.context, RiggedHand.of(ours), source, frames)
    np.testing.assert_allclose(read(ours, frames[-1]).forearm, 0, atol=1e-5)


@ONE_SIDE
def test_stopping_leaves_no_constraint_and_no_bone(moving, random_pose):
    made, _, ours = moving
    write_hand_pose(RiggedHand.of(ours), replace(random_pose(0, made.side), forearm=np.full(3, 0.3)))

    def state():
        drivers = sorted((curve.data_path, curve.array_index) for curve in ours.animation_data.drivers)
        return drivers, {bone.name: [c.name for c in bone.constraints] for bone in ours.pose.bones}

    before, pose = state(), read(ours, 1)
    follow(bpy.context, RiggedHand.of(ours), SourceRig(made.armature, made.joint_map), fits_shape=False)
    assert state() != before
    stop_following(bpy.context, RiggedHand.of(ours), keeps_pose=False)
    assert state() == before
    np.testing.assert_allclose(read(ours, 1).forearm, pose.forearm, atol=1e-5)


@ONE_SIDE
def test_the_panels_forearm_is_guessed_used_and_checked(other_rigs, moving):
    made, _, ours = moving
    rig = ours.livehand.other_rig
    rig.armature = made.armature
    bpy.context.view_layer.objects.active = ours
    assert bpy.ops.livehand.guess_bones() == {"FINISHED"}
    assert rig.forearm == other_rigs.FOREARM
    assert bpy.ops.livehand.follow_rig() == {"FINISHED"}
    (along, *_), (other, *_) = ours_and_theirs(other_rigs, ours, made)
    assert along @ other > 1 - 1e-6
    rig.forearm = rig.wrist
    with pytest.raises(RuntimeError, match="one joint only"):
        bpy.ops.livehand.follow_rig()
    with pytest.raises(LiveHandError, match="it has none"):
        follow(bpy.context, RiggedHand.of(ours), SourceRig(made.armature, replace(made.joint_map, forearm="none")))


def test_a_bone_above_the_wrist_that_is_far_or_in_front_is_no_forearm(other_rigs, armed_model):
    skeleton = read_skeleton(other_rigs.make_rigged_hand(armed_model.side).armature)
    forearm, wrist = (skeleton.index(name) for name in (other_rigs.FOREARM, other_rigs.JOINTS[0]))
    assert guess_joints(skeleton).forearm == other_rigs.FOREARM
    arm = skeleton.heads[forearm] - skeleton.heads[wrist]
    for factor in (0.0, 20.0, -1.0):
        heads = skeleton.heads.copy()
        heads[forearm] = heads[wrist] + factor * arm
        assert guess_joints(replace(skeleton, heads=heads)).forearm is None
