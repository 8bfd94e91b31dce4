"""Characters of MakeHuman and its add-on MPFB: both hands in one armature, numbered fingers, bones in the palm."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.bones import bone_name
from livehand.backend.rigs.doubts import rest_doubts
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.backend.rigs.rest_alignment import align
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rigs.follow import follow
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton

NUMBERS = (2, 3, 5, 4, 1)  # of the fingers in MANO's order


def names(side):
    """The bones of the default rig in MANO's order."""
    initial = side[0].upper()
    return (f"wrist.{initial}", *(f"finger{number}-{k}.{initial}" for number in NUMBERS for k in (1, 2, 3)))


@pytest.fixture
def character(other_rigs):
    """A rig with the default rig's bones, which ends in the fingers' last joints; numbers of our own."""
    for side in ("right", "left"):
        rig, initial = other_rigs.make_rigged_hand(side, name=side).armature, side[0].upper()
        bones = rig.data.bones
        for before, after in zip(other_rigs.JOINTS, names(side), strict=True):
            bones[before].name = after
        for before, number in zip(other_rigs.METACARPALS, NUMBERS[:4], strict=True):
            bones[before].name = f"metacarpal{number - 1}.{initial}"
        bones[other_rigs.FOREARM].name = f"lowerarm02.{initial}"
        bpy.context.view_layer.objects.active = rig
        bpy.ops.object.mode_set(mode="EDIT")
        for tip in other_rigs.TIPS:
            rig.data.edit_bones.remove(rig.data.edit_bones[tip])
        bpy.ops.object.mode_set(mode="OBJECT")
    for name in ("right", "left"):
        bpy.data.objects[name].select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects["right"]
    bpy.ops.object.join()
    bpy.context.view_layer.update()
    return bpy.data.objects["right"]


@pytest.mark.parametrize("model", ["right", pytest.param("left", marks=pytest.mark.nightly)], indirect=True)
def test_a_hand_follows_either_side(character, model):
    skeleton = read_skeleton(character)
    found = guess_joints(skeleton, model.side).joint_map()
    assert found.bones == names(model.side)
    assert found.missing == ()
    assert found.forearm == f"lowerarm02.{model.side[0].upper()}"
    alignment = align(skeleton, found, model)
    assert rest_doubts(alignment) is None
    error_mm = 1e3 * np.linalg.norm(alignment.joints - alignment.heads, axis=1) / alignment.shape.scale
    assert error_mm.mean() < 4
    hand = add_hand(bpy.context, model)
    assert follow(bpy.context, RiggedHand.of(hand), SourceRig(character, found)) is None
    for name in found.bones[1:3] + found.bones[10:12]:  # the index and the ring finger
        bone = character.pose.bones[name]
        axis = np.cross(*(np.array(bone.matrix.to_3x3()).T[k] for k in (1, 2)))
        bone.rotation_mode = "AXIS_ANGLE"
        bone.rotation_axis_angle = (0.3, *(np.array(bone.matrix.to_3x3()).T @ axis))
    bpy.context.view_layer.update()
    evaluated = [thing.evaluated_get(bpy.context.evaluated_depsgraph_get()) for thing in (character, hand)]
    for first in range(1, 16, 3):
        for joint in (first, first + 1):
            theirs = _along(evaluated[0], found.bones[joint], found.bones[joint + 1])
            ours = _along(evaluated[1], bone_name(joint, model.side), bone_name(joint + 1, model.side))
            assert theirs @ ours > 1 - 1e-4


def _along(armature, start, end):
    """The unit direction between the heads of two posed bones in the world."""
    heads = [np.array(armature.matrix_world @ armature.pose.bones[name].head) for name in (start, end)]
    return (heads[1] - heads[0]) / np.linalg.norm(heads[1] - heads[0])
