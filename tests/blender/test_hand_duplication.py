"""Copies and deletions of a hand take its mesh along, which cannot be selected itself."""

import bpy
import pytest
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands, mesh_of
from livehand.livehand_blender.rig.pose import write_hand_pose


def updated():
    bpy.context.view_layer.update()


def select(*things):
    updated()  # what was just added cannot be selected before
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing in things)


def meshes():
    return [thing for thing in bpy.data.objects if thing.type == "MESH" and thing.users_scene]


@pytest.fixture
def matches(evaluated_vertices, backend_vertices, model):
    def check(hand, pose):
        return abs(evaluated_vertices(hand) - backend_vertices(model, pose)).max() < 1e-5

    return check


def test_a_click_on_the_mesh_selects_the_armature(hand):
    select(mesh_of(hand))
    bpy.context.view_layer.objects.active = mesh_of(hand)
    updated()
    assert bpy.context.selected_objects == [hand]
    assert bpy.context.view_layer.objects.active == hand


def test_a_mesh_that_is_sculpted_or_meant_to_be_stays_selected(hand):
    mesh = mesh_of(hand)
    mesh.livehand.mesh_selectable = True
    select(mesh)
    bpy.context.view_layer.objects.active = mesh
    updated()
    assert bpy.context.selected_objects == [mesh]
    bpy.ops.object.mode_set(mode="SCULPT")
    mesh.livehand.mesh_selectable = False
    updated()
    assert bpy.context.view_layer.objects.active == mesh
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_hidden_armature_leaves_its_mesh_selected(hand):
    hand.hide_set(True)
    select(mesh_of(hand))
    updated()
    assert bpy.context.selected_objects == [mesh_of(hand)]


@pytest.mark.parametrize("linked", [False, True])
def test_a_copied_armature_gets_a_mesh_of_its_own(hand, model, random_pose, matches, linked):
    updated()
    select(hand)
    bpy.ops.object.duplicate(linked=linked)
    updated()
    (copy,) = [thing for thing in find_hands(bpy.context.scene) if thing != hand]
    assert mesh_of(copy) != mesh_of(hand)
    assert not mesh_of(copy).livehand.mesh_selectable
    poses = [random_pose(seed, model.side) for seed in (1, 2)]
    for one, pose in zip((hand, copy), poses, strict=True):
        write_hand_pose(RiggedHand.of(one), pose)
    assert matches(hand, poses[0])
    assert matches(copy, poses[1])
    assert len(meshes()) == 2


def test_a_copy_of_a_copy_and_of_both_objects_has_one_mesh(hand):
    mesh_of(hand).livehand.mesh_selectable = True
    updated()
    select(hand, mesh_of(hand))
    bpy.ops.object.duplicate()
    updated()
    assert len(meshes()) == 2
    (copy,) = [thing for thing in find_hands(bpy.context.scene) if thing != hand]
    mesh_of(copy).livehand.mesh_selectable = False
    select(copy)
    bpy.ops.object.duplicate()
    updated()
    hands = find_hands(bpy.context.scene)
    assert len({mesh_of(one).name for one in hands}) == len(hands) == 3


def test_a_deleted_armature_takes_its_mesh_along(hand):
    updated()
    select(hand)
    bpy.ops.object.duplicate()
    updated()
    (copy,) = [thing for thing in find_hands(bpy.context.scene) if thing != hand]
    select(copy)
    bpy.ops.object.delete()
    updated()
    assert meshes() == [mesh_of(hand)]
    select(hand)
    bpy.ops.object.delete()
    updated()
    assert not meshes()
    assert not find_hands(bpy.context.scene)


def test_a_mesh_that_may_be_selected_stays(hand):
    mesh = mesh_of(hand)
    mesh.livehand.mesh_selectable = True
    updated()
    bpy.data.objects.remove(hand)
    updated()
    assert meshes() == [mesh]


def test_undo_brings_the_whole_hand_back(hand):
    updated()
    bpy.ops.ed.undo_push(message="Add hand")
    select(hand)
    bpy.ops.object.delete()
    bpy.ops.ed.undo_push(message="Delete")
    updated()
    assert not meshes()
    bpy.ops.ed.undo()
    (back,) = find_hands(bpy.context.scene)
    assert mesh_of(back).parent == back


def test_old_hands_stay_as_they_are(hand):
    mesh = mesh_of(hand)
    mesh.livehand.is_skin = False
    updated()
    select(hand)
    bpy.ops.object.duplicate()
    updated()
    assert meshes() == [mesh]
