"""A take to BVH, FBX, glTF and USD, and back through Blender's importers, as *Import Motion* reads rigs."""

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.motion.writers.posed_joints import JOINT_NODES, pose_joints
from livehand.backend.motion.writers.skeleton import bone_names
from livehand.backend.motion.writers.take import Take, TakenHand, take_of
from livehand.backend.motion.writers.writer import WriteOptions
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.shape_fit import HandShape
from livehand.livehand_blender.motion.taking import sample_take
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rigs.blender_writers import ALL_WRITERS
from livehand.livehand_blender.rigs.importing import RigFile, all_data, read_rig_file

# Blender's importer of BVH leaves its file open.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
MOST_DEG, MOST_M = 0.1, 0.001
FPS = 30000 / 1001


def taken(side, beta=None, first=0, scale=1.0):
    rng = np.random.default_rng(5)
    axes = FingerAxes.of_default_hand()
    fist, point = (theta_of(GESTURES[name].angles_deg(), axes) for name in ("fist", "point"))
    share = np.linspace(0, 1, 8)[:, None, None]
    theta = (1 - share) * fist + share * point + rng.normal(size=(8, 16, 3)) * 0.05
    theta[:, 0] = np.array([0.5, -0.8, 2.0]) + np.cumsum(rng.normal(size=(8, 3)) * 0.2, 0)
    transl, forearm = np.cumsum(rng.normal(size=(8, 3)) * 0.02, 0), rng.normal(size=(8, 3)) * 0.2
    if side == "left":
        theta, transl, forearm = theta * MIRROR_AXIS_ANGLE, transl * MIRROR_POINT, forearm * MIRROR_AXIS_ANGLE
    beta = np.zeros(10) if beta is None else beta
    return TakenHand(HandMotion(theta, beta, transl, FPS, side, forearm), load_default_hand(), scale, first)


def written(name, take, folder):
    writer = next(writer for writer in ALL_WRITERS if writer.name == name)
    path = folder / f"take{writer.suffixes[0]}"
    writer.write(take, path, WriteOptions())
    return path


def apart_deg(a, b):
    turns = axis_angle_to_matrix(a).swapaxes(-1, -2) @ axis_angle_to_matrix(b)
    return np.rad2deg(np.linalg.norm(matrix_to_axis_angle(turns), axis=-1))


def use_rate():
    """glTF has no rate: it is read at the scene's."""
    render = bpy.context.scene.render
    render.fps, render.fps_base = 30, 1.001


@pytest.mark.parametrize("shape", ["mean", "other"])
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", ["bvh", "fbx", "gltf"])
def test_a_motion_comes_back(tmp_path, name, side, shape):
    use_rate()
    beta = None if shape == "mean" else np.random.default_rng(1).normal(size=10) * 0.6
    sent = taken(side, beta)
    path = written(name, Take((sent,), FPS), tmp_path)
    before = all_data()
    known = None if shape == "mean" else HandShape(beta, 1.0)
    found = read_rig_file(bpy.context, RigFile(path), load_default_hand(), known)
    assert all_data() == before
    assert found.doubt is None
    assert found.motion.side == side
    assert found.motion.fps == pytest.approx(FPS, rel=1e-6)
    assert len(found.motion) == len(sent.motion)
    assert apart_deg(found.motion.theta, sent.motion.theta).max() < MOST_DEG
    assert apart_deg(found.motion.forearms, sent.motion.forearms).max() < MOST_DEG
    ours, theirs = (rest_wrists(sent.own_model, motion.betas) + motion.transl for motion in (sent.motion, found.motion))
    np.testing.assert_allclose(theirs, ours, atol=MOST_M)


@pytest.mark.parametrize("name", ["bvh", "fbx", "gltf"])
def test_two_hands_come_back(tmp_path, name):
    use_rate()
    take = take_of([taken("left", first=2), taken("right")], FPS)
    path = written(name, take, tmp_path)
    for sent in take.hands:
        found = read_rig_file(bpy.context, RigFile(path, sent.side), load_default_hand())
        assert (found.motion.side, len(found.motion)) == (sent.side, 10)
        assert apart_deg(found.motion.theta[sent.frames], sent.motion.theta).max() < MOST_DEG


def test_a_large_hand_is_written_large(tmp_path):
    use_rate()
    path = written("fbx", Take((taken("right", scale=1.2),), FPS), tmp_path)
    assert read_rig_file(bpy.context, RigFile(path), load_default_hand()).shape.scale == pytest.approx(1.2, rel=1e-3)


def test_usd_holds_the_joints_and_their_times(tmp_path):
    """By Blender's importer of USD, which reads skeletons; joints are where ours are."""
    use_rate()
    sent = taken("right")
    path = written("usd", Take((sent,), FPS), tmp_path)
    bpy.ops.wm.usd_import(filepath=str(path))
    armature = next(thing for thing in bpy.context.scene.objects if thing.type == "ARMATURE")
    mesh = next(thing for thing in bpy.context.scene.objects if thing.type == "MESH")
    assert mesh.find_armature() == armature
    wanted = pose_joints(sent.motion, sent.own_model).nodes
    for frame in range(8):
        bpy.context.scene.frame_set(frame)
        for name, node in (("RightHand", 0), ("RightHandIndex1", 1), ("RightHandIndex3", 3), ("RightHandThumb3", 19)):
            bone = next(bone for bone in armature.pose.bones if bone.name.endswith(name))
            place = np.array(armature.matrix_world @ bone.head)
            np.testing.assert_allclose(place, wanted[frame, node], atol=MOST_M)


@pytest.mark.parametrize("side", ["right", "left"])
def test_blenders_importer_of_usd_gives_the_joints_back(tmp_path, side):
    """LiveHand reads no USD: every joint's place, and how it has turned since the first frame."""
    bpy.ops.wm.read_homefile(use_empty=True)
    sent = taken(side)
    bpy.ops.wm.usd_import(filepath=str(written("usd", Take((sent,), FPS), tmp_path)))
    (armature,) = (thing for thing in bpy.context.scene.objects if thing.type == "ARMATURE")
    places, turns = [], []
    for frame in range(len(sent.motion)):
        bpy.context.scene.frame_set(frame)
        bones = [armature.matrix_world @ armature.pose.bones[name].matrix for name in bone_names(side)[:16]]
        places.append([bone.translation for bone in bones])
        turns.append([bone.to_3x3().normalized() for bone in bones])
    wanted, turns = pose_joints(sent.motion, sent.own_model), np.array(turns, np.float64)
    np.testing.assert_allclose(places, wanted.nodes[:, list(JOINT_NODES)], atol=1e-5)
    found, sent_turns = (one @ one[:1].swapaxes(-1, -2) for one in (turns, wanted.rotations))
    apart = matrix_to_axis_angle(found.swapaxes(-1, -2) @ sent_turns)
    assert np.rad2deg(np.linalg.norm(apart, axis=-1)).max() < MOST_DEG


def test_a_hand_is_sampled_where_it_is_in_the_world(model):
    """Its object moves, turns and is twice as large; joints are where Blender has them."""
    hand = add_hand(bpy.context, model)
    hand.scale = (2, 2, 2)
    for frame, place in ((1, (0, 0, 0)), (3, (1, 2, 3))):
        hand.location, hand.rotation_euler = place, (0.3 * frame, 0.2, 0)
        hand.keyframe_insert("location", frame=frame)
        hand.keyframe_insert("rotation_euler", frame=frame)
    take = sample_take(bpy.context, [RiggedHand.of(hand)], range(1, 4))
    one = take.hands[0]
    assert one.scale == pytest.approx(2)
    nodes = pose_joints(one.motion, one.own_model, one.scale).nodes
    for index, frame in enumerate(range(1, 4)):
        bpy.context.scene.frame_set(frame)
        initial = model.side[0].upper()
        for name, node in ((f"wrist.{initial}", 0), (f"index2.{initial}", 2), (f"thumb3.{initial}", 19)):
            place = hand.matrix_world @ hand.pose.bones[name].head
            np.testing.assert_allclose(nodes[index, node], place, atol=1e-5)
    assert np.abs(one.own.transl).max() < 1e-6


def test_a_mirrored_hand_is_refused(model):
    hand = add_hand(bpy.context, model)
    hand.scale = (-1, 1, 1)
    with pytest.raises(LiveHandError, match="must not be scaled by negative"):
        sample_take(bpy.context, [RiggedHand.of(hand)], range(1, 3))
