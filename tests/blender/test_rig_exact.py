"""Blender's own evaluated mesh against the backend's skinning."""

from dataclasses import replace

import bpy
import numpy as np
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose
from livehand.livehand_blender.rig.sliders import write_slider

TOLERANCE_M = 1e-5


def farthest(a, b):
    return np.linalg.norm(a - b, axis=-1).max()


def test_mesh_equals_the_backend_for_100_random_poses_and_shapes(
    hand, model, random_pose, evaluated_vertices, backend_vertices
):
    worst = 0.0
    for seed in range(100):
        pose = random_pose(seed, model.side)
        write_hand_pose(RiggedHand.of(hand), pose)
        worst = max(worst, farthest(evaluated_vertices(hand), backend_vertices(model, pose)))
    assert worst <= TOLERANCE_M


def test_rest_mesh_is_the_template(hand, model, evaluated_vertices):
    assert farthest(evaluated_vertices(hand), model.v_template) < 1e-6


def test_beta_set_by_a_script_shapes_the_hand_at_once(hand, model, evaluated_vertices):
    evaluated_vertices(hand)
    write_slider(hand, "beta", 2 * np.eye(10)[3])
    assert farthest(evaluated_vertices(hand), model.v_template + 2 * model.shapedirs[..., 3]) < 1e-6


def test_a_moved_and_scaled_armature_moves_the_mesh_as_a_whole(
    hand, model, random_pose, evaluated_vertices, backend_vertices
):
    pose = random_pose(1, model.side)
    write_hand_pose(RiggedHand.of(hand), pose)
    hand.location, hand.rotation_euler, hand.scale = (1, -2, 0.5), (0.3, -0.7, 2.0), (3.0,) * 3
    bpy.context.view_layer.update()
    assert farthest(evaluated_vertices(hand), backend_vertices(model, pose)) <= TOLERANCE_M
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh_matrix = hand.livehand.mesh.evaluated_get(depsgraph).matrix_world
    np.testing.assert_allclose(mesh_matrix, hand.evaluated_get(depsgraph).matrix_world, atol=1e-6)


def test_keyed_beta_moves_joints_and_shape_together(hand, model, random_pose, evaluated_vertices, backend_vertices):
    pose = random_pose(2, model.side)
    write_hand_pose(RiggedHand.of(hand), pose)
    write_slider(hand, "beta", np.full(10, -2.0))
    hand.keyframe_insert('["beta"]', frame=1)
    write_slider(hand, "beta", np.full(10, 2.0))
    hand.keyframe_insert('["beta"]', frame=11)
    bpy.context.scene.frame_set(1)
    assert farthest(evaluated_vertices(hand), backend_vertices(model, replace(pose, beta=np.full(10, -2.0)))) < 1e-5
    bpy.context.scene.frame_set(6)
    assert farthest(evaluated_vertices(hand), backend_vertices(model, replace(pose, beta=np.zeros(10)))) < 1e-5


def test_a_model_with_dense_correctives_and_moving_wrist_is_exact_too(
    random_pose, evaluated_vertices, backend_vertices
):
    """MANO's own posedirs have full rank, and its wrist joint moves with beta; the built-in hand's do neither."""
    rng = np.random.default_rng(0)
    plain = load_default_hand()
    regressor = plain.J_regressor + rng.random(plain.J_regressor.shape) * 1e-3
    model = replace(
        plain,
        posedirs=rng.normal(size=plain.posedirs.shape) * 2e-4,
        shapedirs=plain.shapedirs + rng.normal(size=plain.shapedirs.shape) * 1e-3,
        J_regressor=regressor / regressor.sum(1, keepdims=True),
    )
    assert np.abs((model.J_regressor @ model.shapedirs[..., 0])[0]).max() > 1e-4
    hand = add_hand(bpy.context, model)
    for seed in range(5):
        pose = random_pose(seed, "right")
        write_hand_pose(RiggedHand.of(hand), pose)
        assert farthest(evaluated_vertices(hand), backend_vertices(model, pose)) <= TOLERANCE_M
        read = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())
        np.testing.assert_allclose(read.transl, pose.transl, atol=1e-6)
    assert len(hand.livehand.mesh.data.shape_keys.key_blocks) == 1 + 10 + 135


def test_drivers_need_no_python(hand):
    """Blender evaluates simple expressions even in files whose scripts are not trusted."""
    owners = (hand, hand.livehand.mesh.data.shape_keys)
    drivers = [curve.driver for owner in owners for curve in owner.animation_data.drivers]
    assert len(drivers) > 100
    assert all(driver.is_simple_expression and driver.is_valid for driver in drivers)


def test_values_up_to_the_slider_limits_are_not_clamped(hand, model, evaluated_vertices, backend_vertices):
    pose = HandPose(np.zeros((16, 3)), np.eye(10)[0] * 9.5, np.zeros(3), model.side)
    write_hand_pose(RiggedHand.of(hand), pose)
    assert farthest(evaluated_vertices(hand), backend_vertices(model, pose)) <= TOLERANCE_M
