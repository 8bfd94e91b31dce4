"""Rigify, which comes with Blender: hands follow its metarig and the rig generated from it, on both sides."""

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.bones import bone_name, forearm_name
from livehand.backend.rigs.doubts import rest_doubts
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.backend.rigs.rest_alignment import align
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rigs.follow import follow
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        ("right", "metarig"),
        ("left", "generated"),
        pytest.param("left", "metarig", marks=pytest.mark.nightly),
        pytest.param("right", "generated", marks=pytest.mark.nightly),
    ],
    indirect=["model"],
)
def test_a_hand_follows_rigify(rigify_file, model, kind):
    """Guessed without doubt; when the fingers bend, ours point where Rigify's do."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    prefix, rig = "DEF-" if kind == "generated" else "", bpy.data.objects[kind]
    initial = model.side[0].upper()
    skeleton = read_skeleton(rig)
    found = guess_joints(skeleton, model.side).joint_map()
    assert found.bones[:2] == (f"{prefix}hand.{initial}", f"{prefix}f_index.01.{initial}")
    assert found.bones[13:] == tuple(f"{prefix}thumb.0{k}.{initial}" for k in (1, 2, 3))
    assert found.missing == ()
    assert found.forearm == (f"DEF-forearm.{initial}.001" if kind == "generated" else f"forearm.{initial}")
    alignment = align(skeleton, found, model)
    assert rest_doubts(alignment) is None
    error_mm = 1e3 * np.linalg.norm(alignment.joints - alignment.heads, axis=1) / alignment.shape.scale
    assert error_mm.mean() < 7

    hand = add_hand(bpy.context, model)
    assert follow(bpy.context, RiggedHand.of(hand), SourceRig(rig, found)) is None
    for name, angle in (("f_index.01", 0.6), ("f_index.02", 0.8), ("f_ring.02", 1.0), ("thumb.02", 0.3)):
        bone = rig.pose.bones[f"{name}.{initial}"]
        bone.rotation_mode = "XYZ"
        bone.rotation_euler.x = angle
    bpy.context.view_layer.update()
    evaluated = [thing.evaluated_get(bpy.context.evaluated_depsgraph_get()) for thing in (rig, hand)]
    for first in range(1, 16, 3):
        for joint in (first, first + 1):
            theirs = _along(evaluated[0], found.bones[joint], found.bones[joint + 1])
            ours = _along(evaluated[1], bone_name(joint, model.side), bone_name(joint + 1, model.side))
            assert theirs @ ours > 1 - 1e-4


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        ("right", "metarig"),
        ("left", "generated"),
        pytest.param("left", "metarig", marks=pytest.mark.nightly),
        pytest.param("right", "generated", marks=pytest.mark.nightly),
    ],
    indirect=["model"],
)
def test_an_arm_follows_rigifys(rigify_file, armed_model, armed_path, kind):
    """The elbow bends with the forearm's bone, of which the generated rig has two."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    rig, initial = bpy.data.objects[kind], armed_model.side[0].upper()
    found = guess_joints(read_skeleton(rig), armed_model.side).joint_map()
    hand = add_hand(bpy.context, armed_model, str(armed_path))
    follow(bpy.context, RiggedHand.of(hand), SourceRig(rig, found))
    own = (bone_name(0, armed_model.side), forearm_name(armed_model.side))
    before = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).forearm
    bone = rig.pose.bones[f"hand.{initial}" if kind == "metarig" else f"hand_ik.{initial}"]
    bone.rotation_mode = "XYZ"
    bone.rotation_euler.x = 0.5
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    theirs, ours = (thing.evaluated_get(depsgraph) for thing in (rig, hand))
    assert _along(theirs, found.bones[0], found.forearm) @ _along(ours, *own) > 1 - 1e-6
    bent = read_hand_pose(hand, depsgraph).forearm
    turned = axis_angle_to_matrix(before).T @ axis_angle_to_matrix(bent)
    assert np.arccos((np.trace(turned) - 1) / 2) == pytest.approx(0.5, abs=0.01)


def _along(armature, start, end):
    """The unit direction between the heads of two posed bones in the world."""
    heads = [np.array(armature.matrix_world @ armature.pose.bones[name].head) for name in (start, end)]
    return (heads[1] - heads[0]) / np.linalg.norm(heads[1] - heads[0])
