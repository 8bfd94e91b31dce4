"""Depsgraph -> Shot: the hand as the renderer gets it."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.hands.shot import read_shot
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from livehand.livehand_blender.scene.camera import read_camera

VERTEX_COUNT = len(load_default_hand().v_template)


@pytest.fixture
def armature(hand_scene):
    return find_hands(hand_scene)[0]


def shot_now(armature):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = read_camera(bpy.context.scene.camera.evaluated_get(depsgraph), bpy.context.scene.render)
    (hand,) = visible_hands(depsgraph)
    return read_shot(hand, depsgraph, camera, VERTEX_COUNT)


def test_the_rest_hand_is_the_template(armature):
    shot = shot_now(armature)
    assert np.abs(shot.vertices - load_default_hand().v_template).max() < 1e-6
    assert shot.pose.side == "right"
    assert np.abs(shot.pose.theta).max() < 1e-6


def test_vertices_are_in_the_world_with_the_armatures_transform(armature):
    armature.location, armature.scale, armature.rotation_euler = (0.1, 0.2, 0.3), (2, 2, 2), (0, 0, np.pi / 2)
    bpy.context.view_layer.update()
    x, y, z = load_default_hand().v_template.T
    expected = np.stack([-2 * y + 0.1, 2 * x + 0.2, 2 * z + 0.3], -1)
    assert np.abs(shot_now(armature).vertices - expected).max() < 1e-6


def test_modifiers_change_the_shot(armature):
    cast = mesh_of(armature).modifiers.new("Wave", "DISPLACE")
    cast.strength = 0.01
    bpy.context.view_layer.update()
    moved = np.linalg.norm(shot_now(armature).vertices - load_default_hand().v_template, axis=1)
    assert moved.min() > 1e-3


def test_a_modifier_that_adds_vertices_is_an_error(armature):
    mesh_of(armature).modifiers.new("Subdivision", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    with pytest.raises(LiveHandError, match=rf"must keep its hand model's {VERTEX_COUNT} vertices, it has \d+ after"):
        shot_now(armature)


def test_a_hand_is_visible_if_its_mesh_is_even_with_a_hidden_armature(armature):
    armature.hide_viewport = True
    bpy.context.view_layer.update()
    assert visible_hands(bpy.context.evaluated_depsgraph_get())[0].name == armature.name
    mesh_of(armature).hide_viewport = True
    bpy.context.view_layer.update()
    assert visible_hands(bpy.context.evaluated_depsgraph_get()) == ()


def test_all_visible_hands_are_found(armature):
    add_hand(bpy.context, load_default_hand().for_side("left"), name="Other")
    bpy.context.view_layer.update()
    assert [hand.name for hand in visible_hands(bpy.context.evaluated_depsgraph_get())] == ["LiveHand", "Other"]
    mesh_of(armature).hide_viewport = True
    bpy.context.view_layer.update()
    assert [hand.name for hand in visible_hands(bpy.context.evaluated_depsgraph_get())] == ["Other"]


def test_nan_in_the_pose_is_an_error(armature):
    armature.livehand.id_data.pose.bones["index1.R"].rotation_quaternion = (float("nan"), 0, 0, 0)
    armature.pose.bones["index1.R"].rotation_mode = "QUATERNION"
    bpy.context.view_layer.update()
    with pytest.raises(LiveHandError, match="must be finite, got NaN"):
        shot_now(armature)


def test_the_wrists_fade_is_of_the_shot_in_metres_and_can_be_keyed(armature):
    assert shot_now(armature).wrist_fade_m == 0
    for frame, fade_mm in ((1, 10), (3, 30)):
        armature.livehand.wrist_fade = fade_mm
        armature.keyframe_insert("livehand.wrist_fade", frame=frame)
    bpy.context.scene.frame_set(2)
    assert shot_now(armature).wrist_fade_m == pytest.approx(0.02, abs=1e-6)


def test_hair_is_of_the_shot_and_can_be_keyed(armature):
    assert shot_now(armature).hair == 0
    for frame, share in ((1, 0.0), (3, 1.0)):
        armature.livehand.hair = share
        armature.keyframe_insert("livehand.hair", frame=frame)
    bpy.context.scene.frame_set(2)
    assert shot_now(armature).hair == pytest.approx(0.5, abs=1e-6)
