"""A hand works after save, append, link and override, copy, and undo."""

import bpy
import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands, mesh_of
from livehand.livehand_blender.rig.keyframes import keyframe_theta
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose


@pytest.fixture
def matches(model, evaluated_vertices, backend_vertices):
    """A function that checks a hand's mesh against the backend's mesh for a pose."""

    def check(hand, pose):
        return np.abs(evaluated_vertices(hand) - backend_vertices(model, pose)).max() <= 1e-5

    return check


@pytest.fixture
def hand_file(hand, tmp_path):
    path = str(tmp_path / "hand.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    return path


def only_hand():
    (hand,) = find_hands(bpy.context.scene)
    return hand


def driver_targets(owner):
    return {
        target.id
        for curve in owner.animation_data.drivers
        for variable in curve.driver.variables
        for target in variable.targets
    }


def test_a_saved_hand_keeps_its_pose_and_still_works(hand, model, random_pose, matches, tmp_path):
    write_hand_pose(RiggedHand.of(hand), random_pose(0, model.side))
    path = str(tmp_path / "hand.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    hand = only_hand()
    assert matches(hand, random_pose(0, model.side))
    write_hand_pose(RiggedHand.of(hand), random_pose(1, model.side))
    assert matches(hand, random_pose(1, model.side))
    assert hand.livehand.model_sha256 == model.sha256


def test_an_appended_hand_includes_its_mesh(hand_file, model, random_pose, matches):
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.append(filename="LiveHand", directory=f"{hand_file}/Object/")
    hand = only_hand()
    write_hand_pose(RiggedHand.of(hand), random_pose(2, model.side))
    assert matches(hand, random_pose(2, model.side))
    assert hand.library is None
    assert mesh_of(hand).library is None


def test_linked_hand_can_be_posed_through_an_override(hand_file, model, random_pose, matches, tmp_path):
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(hand_file, link=True) as (_, wanted):
        wanted.objects = ["LiveHand"]
    bpy.context.collection.objects.link(wanted.objects[0])
    view_layer = bpy.context.view_layer
    view_layer.update()
    hand = wanted.objects[0].override_hierarchy_create(bpy.context.scene, view_layer, do_fully_editable=True)
    pose = random_pose(3, model.side)
    write_hand_pose(RiggedHand.of(hand), pose)
    assert hand.livehand.mesh.library is None
    assert driver_targets(hand.livehand.mesh.data.shape_keys) == {hand}
    assert matches(hand, pose)

    shot = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    bpy.ops.wm.open_mainfile(filepath=shot)
    (hand,) = [thing for thing in find_hands(bpy.context.scene) if thing.override_library]
    assert matches(hand, pose)


def linked_hand(path):
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["LiveHand"]
    bpy.context.collection.objects.link(wanted.objects[0])
    bpy.context.view_layer.update()
    return wanted.objects[0]


def test_keys_of_an_override_whose_keys_are_linked_are_saved_in_the_shot(hand, model, random_pose, matches, tmp_path):
    first, second = random_pose(6, model.side), random_pose(7, model.side)
    write_hand_pose(RiggedHand.of(hand), first)
    keyframe_theta(RiggedHand.of(hand), first.theta[None], [1])
    path, shot = str(tmp_path / "keyed.blend"), str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    keys = (second.theta[None], [20])
    with pytest.raises(LiveHandError, match="Library Override"):
        keyframe_theta(RiggedHand.of(linked_hand(path)), *keys)
    hand = linked_hand(path).override_hierarchy_create(
        bpy.context.scene, bpy.context.view_layer, do_fully_editable=True
    )
    keyframe_theta(RiggedHand.of(hand), *keys)
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    bpy.ops.wm.open_mainfile(filepath=shot)
    (hand,) = [thing for thing in find_hands(bpy.context.scene) if thing.override_library]
    for frame, pose in ((1, first), (20, second)):
        bpy.context.scene.frame_set(frame)
        theta = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
        np.testing.assert_allclose(theta, pose.theta, atol=1e-5)


def test_a_copy_is_an_independent_hand(hand, model, random_pose, matches):
    for thing in (hand, mesh_of(hand)):
        thing.select_set(True)
    bpy.ops.object.duplicate()
    (copy,) = [thing for thing in find_hands(bpy.context.scene) if thing != hand]
    write_hand_pose(RiggedHand.of(hand), random_pose(4, model.side))
    write_hand_pose(RiggedHand.of(copy), random_pose(5, model.side))
    assert mesh_of(copy) != mesh_of(hand)
    assert matches(hand, random_pose(4, model.side))
    assert matches(copy, random_pose(5, model.side))


def test_mesh_of_a_copied_armature_alone_is_not_the_first_hands_mesh(hand, model):
    copy = hand.copy()
    bpy.context.collection.objects.link(copy)
    assert copy.livehand.mesh == mesh_of(hand)
    with pytest.raises(Exception, match="one mesh that it deforms, got 0"):
        mesh_of(copy)


def test_several_meshes_are_named_with_what_to_do(hand):
    (mesh,) = hand.children
    nails = mesh.copy()
    nails.name = "Nails"
    bpy.context.collection.objects.link(nails)
    hand.livehand.mesh = None
    with pytest.raises(LiveHandError, match=r"got 2 \(LiveHand Mesh, Nails\); choose it as Mesh in the LiveHand tab"):
        mesh_of(hand)


def test_an_appended_hands_bone_shapes_are_out_of_sight(hand_file):
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.append(directory=f"{hand_file}/Object/", filename="LiveHand")
    assert find_hands(bpy.context.scene)
    seen = [thing.name for thing in bpy.context.visible_objects if thing.type == "MESH"]
    assert seen == ["LiveHand Mesh"]


def test_two_hands_are_independent(hand, model, random_pose, matches):
    other = add_hand(bpy.context, model)
    write_hand_pose(RiggedHand.of(hand), random_pose(6, model.side))
    write_hand_pose(RiggedHand.of(other), random_pose(7, model.side))
    assert matches(hand, random_pose(6, model.side))
    assert matches(other, random_pose(7, model.side))


def test_undo_restores_the_pose(hand, model, random_pose):
    bpy.ops.ed.undo_push(message="Add hand")
    write_hand_pose(RiggedHand.of(hand), random_pose(8, model.side))
    bpy.ops.ed.undo_push(message="Pose")
    bpy.ops.ed.undo()
    back = read_hand_pose(only_hand(), bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(back.theta, 0, atol=1e-6)
    np.testing.assert_allclose(back.beta, 0, atol=1e-6)
