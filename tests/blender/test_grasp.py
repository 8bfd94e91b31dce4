"""*Grasp* in a scene: what it touches, keys, undoes and refuses, both hands alike."""

from types import SimpleNamespace

import bpy
import mathutils
import numpy as np
import pytest
from livehand.backend.contact.grasp import GraspOptions
from livehand.backend.contact.solid import MeshSolid
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.contact.grasping import GraspedFrames, GraspStopped, grasped_frames, read_frames
from livehand.livehand_blender.contact.targets import Targets, selected_targets
from livehand.livehand_blender.hands.shot import read_shot
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pads import pads_keys
from livehand.livehand_blender.rig.pose import read_hand_pose, write_theta
from livehand.livehand_blender.ui.posing import LIVEHAND_OT_grasp_frames

# Of a ball in front of a right hand's palm, in the hand's own space.
TILT_RAD = 0.25  # of hands in prayer: straight fingers stand back from the palms' heels
CENTRE_M, RADIUS_M = np.array([-0.02, -0.062, 0.006]), 0.034


def posed(hand, pose="Power Sphere"):
    side = hand.livehand.side
    theta = theta_of(POSES[pose].gesture.angles_deg(), FingerAxes.of_default_hand())
    write_theta(RiggedHand.of(hand), theta if side == "right" else theta * MIRROR_AXIS_ANGLE)
    hand.update_tag()
    return hand


def add_ball(hand, away_m=(0, 0, 0), radius=RADIUS_M):
    """A ball of modifiers, scaled as an object."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    ball = bpy.context.active_object
    subdivided = ball.modifiers.new("Subdivision", "SUBSURF")
    subdivided.levels = 4
    cast = ball.modifiers.new("Cast", "CAST")
    cast.factor, cast.radius, cast.use_radius_as_size = 1.0, 1.0, False
    cast.size = 1.0
    ball.scale = (radius,) * 3
    mirror = (1, 1, 1) if hand.livehand.side == "right" else (-1, 1, 1)
    ball.location = hand.matrix_world @ mathutils.Vector((CENTRE_M + np.array(away_m)) * mirror)
    bpy.context.view_layer.update()
    return ball


def select(hand, *things):
    bpy.ops.object.select_all(action="DESELECT")
    for thing in (*things, hand):
        thing.select_set(True)
    bpy.context.view_layer.objects.active = hand


def depths_mm(hand, thing, evaluated_vertices):
    """Signed distances of the evaluated hand's vertices from an evaluated object, both in the world."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = thing.evaluated_get(depsgraph).to_mesh()
    matrix = np.array(thing.matrix_world)
    mesh.calc_loop_triangles()
    corners = np.array([tuple(vertex.co) for vertex in mesh.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]
    faces = np.array([tuple(triangle.vertices) for triangle in mesh.loop_triangles])
    return 1000 * MeshSolid(corners, faces).distances(world_vertices_of(hand, evaluated_vertices)).signed_m


def world_vertices_of(hand, evaluated_vertices):
    world = np.array(hand.livehand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
    return evaluated_vertices(hand) @ world[:3, :3].T + world[:3, 3]


def test_a_ball_with_modifiers_is_grasped_and_no_vertex_is_deeper_than_the_skin_yields(hand, evaluated_vertices):
    hand.location, hand.rotation_euler = (0.3, -0.2, 1.1), (0.4, 0.7, -0.5)
    bpy.context.view_layer.update()
    ball = add_ball(posed(hand))
    select(hand, ball)
    assert bpy.ops.livehand.grasp() == {"FINISHED"}
    depth = depths_mm(hand, ball, evaluated_vertices)
    joint = load_default_hand().lbs_weights.argmax(1)
    assert depth.min() > -0.1  # pads are flat
    touching = [digit for digit in range(5) if depth[(joint - 1) // 3 == digit].min() < 1.0]
    assert 4 in touching
    assert len(touching) >= 3
    assert [key.name for key in hand.livehand.mesh.data.shape_keys.key_blocks if "Grasp" in key.name] == [
        "Grasp Pads 1"
    ]


def test_without_flat_pads_they_press_as_deep_as_asked(hand, evaluated_vertices):
    ball = add_ball(posed(hand))
    select(hand, ball)
    bpy.ops.livehand.grasp(flatten=True)
    bpy.ops.livehand.grasp(flatten=False, press=0.4)
    assert -0.6 < depths_mm(hand, ball, evaluated_vertices).min() < -0.1
    assert not [key for key in hand.livehand.mesh.data.shape_keys.key_blocks if "Grasp" in key.name]


def test_only_the_chosen_fingers_move(hand):
    ball = add_ball(posed(hand, "Open"))
    before = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
    select(hand, ball)
    bpy.ops.livehand.grasp(fingers={"index", "middle"})
    moved = np.abs(read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta - before).max(1) > 1e-4
    assert not moved[[0, 7, 8, 9, 10, 11, 12, 13, 14, 15]].any()
    assert moved[[1, 4]].all()


@pytest.mark.parametrize(
    ("away_m", "match"),
    [((0, -0.5, 0), "a finger must reach Cube"), ((0, 0.06, 0), "the palm must not be inside Cube, it is")],
)
def test_what_cannot_be_grasped_is_refused_and_nothing_changes(hand, away_m, match):
    ball = add_ball(posed(hand), away_m)
    before = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
    select(hand, ball)
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.livehand.grasp()
    np.testing.assert_array_equal(read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta, before)


def test_a_hand_is_moved_out_on_wish(hand):
    ball = add_ball(posed(hand), (0, 0.022, 0))
    select(hand, ball)
    assert bpy.ops.livehand.grasp(move_wrist=True) == {"FINISHED"}
    transl = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).transl
    assert 0.001 < np.linalg.norm(transl) < 0.03


def test_words_for_what_is_missing(hand):
    select(hand)
    with pytest.raises(RuntimeError, match="an object to grasp must be selected beside the hand"):
        bpy.ops.livehand.grasp()
    empty = bpy.data.objects.new("Nothing", None)
    bpy.context.scene.collection.objects.link(empty)
    select(hand, empty)
    with pytest.raises(RuntimeError, match="Nothing has none; deselect it"):
        bpy.ops.livehand.grasp()
    points = bpy.data.objects.new("Points", bpy.data.meshes.new("Points"))
    bpy.context.scene.collection.objects.link(points)
    select(hand, points)
    with pytest.raises(RuntimeError, match="Points: the object must have faces with an area"):
        bpy.ops.livehand.grasp()
    hand.scale = (1, 1, 2)
    bpy.context.view_layer.update()
    select(hand, add_ball(hand))
    with pytest.raises(RuntimeError, match="must be scaled by one positive number"):
        bpy.ops.livehand.grasp()


def shot_of(hand):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (visible,) = visible_hands(depsgraph)
    camera = Camera(np.eye(3), np.eye(4), (1, 1))
    return read_shot(visible, depsgraph, camera, len(hand.livehand.mesh.data.vertices))


def test_pressed_skin_is_in_the_shot_and_follows_the_values_of_its_keys(hand, evaluated_vertices):
    ball = add_ball(posed(hand))
    assert shot_of(hand).pressed_m is None
    select(hand, ball)
    bpy.ops.livehand.grasp(flatten=False)
    assert shot_of(hand).pressed_m is None
    bpy.ops.livehand.grasp(flatten=True)
    pressed_m, flat = shot_of(hand).pressed_m, evaluated_vertices(hand)
    (key,) = pads_keys(hand.livehand.mesh.data.shape_keys)
    key.value = 0.5
    bpy.context.view_layer.update()
    np.testing.assert_allclose(shot_of(hand).pressed_m, pressed_m / 2, atol=1e-7)
    key.mute = True
    bpy.context.view_layer.update()
    assert shot_of(hand).pressed_m is None
    moved_m = np.linalg.norm(flat - evaluated_vertices(hand), axis=1)
    assert 0.0005 < moved_m.max() < 0.0012
    np.testing.assert_allclose(pressed_m, moved_m, atol=3e-5)


def test_one_undo_takes_a_grasp_back(hand):
    ball = add_ball(posed(hand))
    select(hand, ball)
    bpy.ops.ed.undo_push(message="Before")
    before = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
    frames = {"use_scene_range": False, "first": 1, "last": 2}
    assert bpy.ops.livehand.grasp_frames("EXEC_DEFAULT", True, **frames) == {"FINISHED"}
    bpy.ops.ed.undo()
    hand = bpy.context.view_layer.objects.active
    np.testing.assert_allclose(read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta, before, atol=1e-7)
    keys = hand.livehand.mesh.data.shape_keys
    assert not pads_keys(keys)
    assert all(one.animation_data is None or one.animation_data.action is None for one in (hand, keys))
    bpy.ops.ed.redo()
    assert pads_keys(bpy.context.view_layer.objects.active.livehand.mesh.data.shape_keys)


def test_frames_are_grasped_beside_blender_until_they_are_stopped(hand):
    """What Esc does: the job ends at its next frame, and nothing has changed."""
    select(hand, add_ball(posed(hand)))
    rigged = RiggedHand.of(hand)
    targets = Targets(selected_targets(bpy.context, rigged))
    shot = read_frames(bpy.context, rigged, targets, range(1, 4))
    told = []
    found = grasped_frames(load_default_hand(), shot, GraspOptions(), False, told.append)
    assert len(found.grasps) == 3
    shares = [one.share for one in told]
    assert shares[0] == 0
    assert shares[-1] == pytest.approx(1)
    assert shares == sorted(shares)
    assert len(shares) == 7
    heard = []
    with pytest.raises(GraspStopped):
        grasped_frames(load_default_hand(), shot, GraspOptions(), False, heard.append, lambda: len(heard) == 2)
    assert len(heard) == 2
    assert hand.animation_data is None or hand.animation_data.action is None


def test_a_hand_that_is_gone_when_its_grasps_are_found_is_named(hand):
    asked = SimpleNamespace(_hand="Gone", _frames=[1], report=lambda kind, text: None)
    job = SimpleNamespace(result=lambda: GraspedFrames([], None))
    with pytest.raises(LiveHandError, match="Gone must stay in the scene until it is keyed, it is gone"):
        LIVEHAND_OT_grasp_frames.take(asked, bpy.context, job)


@pytest.mark.slow
def test_a_range_is_keyed_and_the_fingers_follow_a_ball_that_wanders(hand, evaluated_vertices, curves_of):
    scene = bpy.context.scene
    ball = add_ball(posed(hand))
    start = ball.location.copy()
    for frame, shift in ((1, 0.0), (5, -0.004)):
        ball.location = start
        ball.location.y += shift
        ball.keyframe_insert("location", frame=frame)
    select(hand, ball)
    assert bpy.ops.livehand.grasp_frames(use_scene_range=False, first=1, last=5) == {"FINISHED"}
    names = {curve.data_path.split('"')[1] for curve in curves_of(hand.animation_data.action)}
    assert len(names) == 15
    assert not any(name.startswith(("wrist", "forearm")) for name in names)
    curves = [
        *curves_of(hand.animation_data.action),
        *curves_of(hand.livehand.mesh.data.shape_keys.animation_data.action),
    ]
    assert {tuple(point.co.x for point in curve.keyframe_points) for curve in curves} == {(1, 2, 3, 4, 5)}
    for frame in (1, 3, 5):
        scene.frame_set(frame)
        depth = depths_mm(hand, ball, evaluated_vertices)
        assert -0.3 < depth.min() < 0.3


@pytest.mark.slow
def test_two_hands_in_prayer_touch_and_do_not_pass_through_each_other(evaluated_vertices):
    model = load_default_hand()
    right, left = (posed(add_hand(bpy.context, one), "Five") for one in (model, model.for_side("left")))
    right.rotation_euler, left.rotation_euler = (0, 0, TILT_RAD), (0, 0, np.pi - TILT_RAD)
    bpy.context.view_layer.update()
    meet_m = world_vertices_of(right, evaluated_vertices)[:, 1].min() - 0.0005
    left.location = (0, 2 * meet_m, 0)
    bpy.context.view_layer.update()
    select(right, left)
    assert bpy.ops.livehand.grasp() == {"FINISHED"}
    digit = (model.lbs_weights.argmax(1) - 1) // 3
    for one, other in ((right, left), (left, right)):
        gap_mm = depths_mm(one, other.livehand.mesh, evaluated_vertices)
        assert gap_mm.min() > -1
        assert max(gap_mm[digit == number].min() for number in range(5)) < 1
