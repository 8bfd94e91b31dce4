"""A character's own skin lies where the hand lies that follows it, and does not shadow that; what it holds does."""

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.hands.followed_skin import followed_hands
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.light.occluders import read_solids
from livehand.livehand_blender.light.solids import LocalTriangles
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rigs.bake import bake
from livehand.livehand_blender.rigs.follow import follow
from livehand.livehand_blender.rigs.source import SourceRig


class Everywhere:
    """A reach that all things touch."""

    def touches(self, centres, radii):
        return np.ones(len(centres), bool)


def solids():
    """Triangles that may shadow the only hand, by object."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (hand,) = visible_hands(depsgraph)
    found = read_solids(depsgraph, {hand.instance_id: Everywhere()}, LocalTriangles())
    return {solid.instance_id.name: len(solid.triangles) for solid in found}


def egg_in(hand_mesh):
    """A ball in the palm, which touches fingers and encloses none."""
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.02)
    egg = bpy.context.object
    corners = np.array([hand_mesh.matrix_world @ vertex.co for vertex in hand_mesh.data.vertices])
    egg.location = np.add(corners.mean(0), [0, 0, 0.02])
    return egg


@pytest.fixture
def made(other_rigs, model):
    return other_rigs.make_rigged_hand(model.side)


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
def test_the_skin_of_the_followed_rig_is_left_out(made, model, way):
    ours = add_hand(bpy.context, model)
    egg = egg_in(made.mesh)
    egg.parent, egg.matrix_parent_inverse = made.armature, made.armature.matrix_world.inverted()
    before = solids()
    source = SourceRig(made.armature, made.joint_map)
    if way == "live":
        follow(bpy.context, RiggedHand.of(ours), source)
    else:
        chosen = ours.livehand.other_rig
        chosen.armature = made.armature
        for joint, bone in zip(
            ("wrist", *(f"{f}{k}" for f in FINGERS for k in (1, 2, 3))), made.joint_map.bones, strict=True
        ):
            setattr(chosen, joint, bone)
        bake(bpy.context, RiggedHand.of(ours), source, [1])
    bpy.context.view_layer.update()
    after = solids()
    assert after[made.mesh.name] < 0.1 * before[made.mesh.name]
    assert after[egg.name] == before[egg.name] > 0


FINGERS = ("index", "middle", "pinky", "ring", "thumb")


def test_a_hand_elsewhere_is_shadowed_by_the_character(made, model):
    ours = add_hand(bpy.context, model)
    ours.livehand.other_rig.armature = made.armature
    ours.livehand.other_rig.wrist = "wrist"
    ours.location = (0.5, 0, 0)
    bpy.context.view_layer.update()
    assert followed_hands(bpy.context.evaluated_depsgraph_get()) == []
    assert solids()[made.mesh.name] > 0
