"""Our hand's motion onto other rigs as keys, and back by *Follow* and *Bake*: the same joints in the same places."""

import re
from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.backend.rigs.rest_alignment import align
from livehand.backend.rigs.sent_motion import sent_motion
from livehand.backend.rigs.shape_fit import HandShape
from livehand.livehand_blender.motion.keying import sample_motion
from livehand.livehand_blender.motion.taking import sample_take
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta, keyframe_transl
from livehand.livehand_blender.rigs.aimed_bones import with_twists
from livehand.livehand_blender.rigs.bake import bake
from livehand.livehand_blender.rigs.follow import follow
from livehand.livehand_blender.rigs.sending import send
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton, sample_source
from livehand.tests.blender.characters import make_character

MOST_DEG, MOST_M = 0.1, 0.001
FRAMES = range(3, 9)


def keyed_hand(model, frames=FRAMES):
    """Our hand, placed, shaped and keyed: gestures, twists, the wrist turns and moves."""
    rng = np.random.default_rng(2)
    hand = add_hand(bpy.context, model)
    hand.location, hand.rotation_euler = (0.1, -0.2, 0.9), (0.3, 0.2, 1.0)
    hand.livehand.beta = rng.normal(size=10) * 0.5
    axes = FingerAxes.of_default_hand()
    gestures = ("fist", "point", "spread", "relaxed", "pinch", "rest")
    theta = np.array([theta_of(GESTURES[name].angles_deg(), axes) for name in gestures[: len(frames)]])
    theta += rng.normal(size=theta.shape) * 0.04
    theta[:, 0] = rng.normal(size=(len(frames), 3)) * 0.5
    transl = rng.normal(size=(len(frames), 3)) * 0.05
    if model.side == "left":
        theta, transl = theta * MIRROR_AXIS_ANGLE, transl * MIRROR_POINT
    rigged = RiggedHand.of(hand)
    keyframe_theta(rigged, theta, frames, forearms=rng.normal(size=(len(frames), 3)) * 0.2)
    keyframe_transl(rigged, transl, frames)
    return rigged


def apart_deg(a, b):
    turns = axis_angle_to_matrix(a).swapaxes(-1, -2) @ axis_angle_to_matrix(b)
    return np.rad2deg(np.linalg.norm(matrix_to_axis_angle(turns), axis=-1))


def sent_and_followed(ours, rig, fits_shape=False, frames=FRAMES, **options):
    """(what `send` returns, our motion, that of another hand which follows the rig), both in their own space."""
    taken = sample_take(bpy.context, [ours], frames).hands[0]
    found = send(bpy.context, taken, rig, frames, fits_shape, **options)
    before = sample_motion(bpy.context, ours, frames)
    doubt = follow(bpy.context, ours, rig, fits_shape)
    assert doubt is None or (options.get("arm") == "IK" and doubt.startswith("the wrist bends"))  # the elbow aims it
    return found, before, sample_motion(bpy.context, ours, frames)


@pytest.mark.parametrize("fits_shape", [False, True])
def test_what_was_sent_comes_back(other_rigs, model, fits_shape):
    """Bones with metacarpals, other rolls, unit, size and rest pose."""
    ours = keyed_hand(model)
    made = other_rigs.make_rigged_hand(model.side)
    made.pose_like(np.zeros((16, 3)), cupped_deg=25)  # the metacarpal must go back to rest
    rig = SourceRig(made.armature, made.joint_map)
    found, before, after = sent_and_followed(ours, rig, fits_shape)
    assert found.doubt is None
    assert (found.frames, found.bones) == (6, 16 + 1 + 4)
    assert apart_deg(before.theta, after.theta).max() < MOST_DEG
    assert apart_deg(before.forearms, after.forearms).max() < MOST_DEG
    if not fits_shape:  # the wrists' joints lie 0.6 mm apart at rest
        np.testing.assert_allclose(after.transl, before.transl, atol=MOST_M / 10)


@pytest.mark.parametrize("kind", ["Mixamo", "Unreal", "MPFB"])
def test_it_comes_back_from_rigs_of_other_programs(other_rigs, model, kind):
    """Their bones are found by name; twelve rigs are in `test_round_trips.py`."""
    armature = make_character(other_rigs, model.side, kind)
    found = guess_joints(read_skeleton(armature), model.side).joint_map()
    assert found.missing == ()
    sent, before, after = sent_and_followed(keyed_hand(model), SourceRig(armature, found))
    assert sent.doubt is None
    assert apart_deg(before.theta, after.theta).max() < MOST_DEG
    np.testing.assert_allclose(after.transl, before.transl, atol=MOST_M)


@pytest.mark.parametrize("mode", ["XYZ", "AXIS_ANGLE"])
def test_bones_keep_their_rotation_mode(other_rigs, model, mode):
    made = other_rigs.make_rigged_hand(model.side)
    for bone in made.armature.pose.bones:
        bone.rotation_mode = mode
    _, before, after = sent_and_followed(keyed_hand(model), SourceRig(made.armature, made.joint_map))
    assert {bone.rotation_mode for bone in made.armature.pose.bones} == {mode}
    assert apart_deg(before.theta, after.theta).max() < MOST_DEG


def test_baking_back_gives_the_same(other_rigs, model):
    made = other_rigs.make_rigged_hand(model.side)
    rig, ours = SourceRig(made.armature, made.joint_map), keyed_hand(model)
    before = sample_motion(bpy.context, ours, FRAMES)
    send(bpy.context, sample_take(bpy.context, [ours], FRAMES).hands[0], rig, FRAMES)
    assert bake(bpy.context, ours, rig, FRAMES, fits_shape=False).doubt is None
    assert apart_deg(before.theta, sample_motion(bpy.context, ours, FRAMES).theta).max() < MOST_DEG


def test_keys_outside_the_frames_stay(other_rigs, model):
    made = other_rigs.make_rigged_hand(model.side)
    made.key(1)
    made.key(20)
    bone = made.armature.pose.bones["wrist"]
    taken = sample_take(bpy.context, [keyed_hand(model)], FRAMES).hands[0]
    send(bpy.context, taken, SourceRig(made.armature, made.joint_map), FRAMES)
    bpy.context.scene.frame_set(20)
    np.testing.assert_allclose(bone.rotation_quaternion, (1, 0, 0, 0), atol=1e-6)
    bpy.context.scene.frame_set(FRAMES[2])
    assert abs(bone.rotation_quaternion[0]) < 0.999


def test_a_hand_is_not_sent_to_the_other_side(other_rigs, model):
    other = "left" if model.side == "right" else "right"
    made = other_rigs.make_rigged_hand(other)
    taken = sample_take(bpy.context, [keyed_hand(model)], FRAMES).hands[0]
    with pytest.raises(LiveHandError, match=f"a {model.side} hand must be sent to a {model.side} one"):
        send(bpy.context, taken, SourceRig(made.armature, made.joint_map), FRAMES)
    assert made.armature.animation_data is None


def test_a_rig_without_ik_controls_is_named(other_rigs, model):
    made = other_rigs.make_rigged_hand(model.side)
    taken = sample_take(bpy.context, [keyed_hand(model)], FRAMES).hands[0]
    with pytest.raises(LiveHandError, match="must have an IK control of 'wrist'"):
        send(bpy.context, taken, SourceRig(made.armature, made.joint_map), FRAMES, arm="IK")
    assert made.armature.animation_data is None


def within_reach(rig, found, model):
    """Our hand, keyed, before the rig's chest."""
    ours = keyed_hand(model)
    alignment = align(read_skeleton(rig), found, ours.model)
    reached = alignment.wrist * (0.75, 1, 1) + (0, -0.15, 0)
    ours.armature.rotation_euler = (0, 0, 0)
    ours.armature.location = reached - np.array(ours.bone(0).bone.head_local)
    bpy.context.view_layer.update()
    return ours


@pytest.mark.parametrize(("kind", "arm"), [("metarig", "FK"), ("generated", "FK"), ("generated", "IK")])
def test_it_comes_back_from_rigify(rigify_file, model, curves_of, kind, arm):
    """The arm reaches for the wrist, and the controls alone have keys."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    rig = bpy.data.objects[kind]
    found = guess_joints(read_skeleton(rig), model.side).joint_map()
    source = SourceRig(rig, with_twists(rig, found))
    firsts = [bone.removeprefix("DEF-") for bone in found.bones[1::3]]
    assert source.joint_map == replace(found, bones=replaced(found.bones, range(1, 16, 3), firsts))
    sent, before, after = sent_and_followed(within_reach(rig, found, model), source, arm=arm)
    assert sent.doubt is None
    assert apart_deg(before.theta, after.theta).max() < MOST_DEG
    np.testing.assert_allclose(after.transl, before.transl, atol=MOST_M)
    keyed = bones_of(curves_of(rig.animation_data.action))
    assert not {name for name in keyed if name.startswith(("DEF-", "ORG-", "MCH-"))}
    assert ("hand_ik" in {name[:-2] for name in keyed}) == (arm == "IK")


def test_rigifys_deforming_bones_point_where_ours_do(rigify_file, model):
    """What they cannot have is told: the twist of a finger's first."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    rig = bpy.data.objects["generated"]
    found = guess_joints(read_skeleton(rig), model.side).joint_map()
    ours = within_reach(rig, found, model)
    taken = sample_take(bpy.context, [ours], FRAMES).hands[0]
    alignment = align(read_skeleton(rig), found, ours.model, HandShape(taken.motion.beta, taken.scale))
    sent = send(bpy.context, taken, SourceRig(rig, found), FRAMES)
    lacking = re.findall(r"(\S+) lacks \d+ degrees of twist", sent.doubt)
    assert lacking
    assert {name.split(".")[1] for name in lacking} == {"01"}
    assert "degrees from" not in sent.doubt
    wanted = sent_motion(taken.motion, alignment).frames
    posed = sample_source(bpy.context, SourceRig(rig, found), FRAMES).frames
    cosines = (wanted[..., 1] * posed[..., 1]).sum(-1)
    assert np.rad2deg(np.arccos(np.clip(cosines, -1, 1))).max() < MOST_DEG
    others = [joint for joint in range(16) if joint % 3 != 1]
    np.testing.assert_allclose(posed[:, others], wanted[:, others], atol=np.deg2rad(MOST_DEG))


def replaced(values, places, others):
    values = list(values)
    for place, other in zip(places, others, strict=True):
        values[place] = other
    return tuple(values)


def bones_of(curves):
    return {curve.data_path.split('"')[1] for curve in curves}
