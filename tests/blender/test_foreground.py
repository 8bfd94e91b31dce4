"""What stands before the hand in a view: triangles of the scene, their part before the camera, and their depth."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.render.surface_maps import scene_depth
from livehand.livehand_blender.hands.shot import hand_vertices
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.light.foreground import Foreground, clipped, foreground_triangles
from livehand.livehand_blender.light.solids import LocalTriangles
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.scene.camera import read_camera

LOOKS_ALONG_Z = Camera(np.array([[40.0, 0, 20], [0, 40, 15], [0, 0, 1]]), np.eye(4), (40, 30))


def add_square(scene, z, name, side_m=0.4):
    mesh = bpy.data.meshes.new(name)
    half = side_m / 2
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    thing = bpy.data.objects.new(name, mesh)
    thing.location.z = z
    scene.collection.objects.link(thing)
    return thing


def foreground(scene):
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hands = visible_hands(depsgraph)
    camera = read_camera(scene.camera.evaluated_get(depsgraph), scene.render)
    vertices = [hand_vertices(hand, depsgraph) for hand in hands]
    around = Foreground(depsgraph, {hand.instance_id for hand in hands}, LocalTriangles())
    return camera, foreground_triangles(around.before(depsgraph, camera, vertices), camera, vertices)


def test_only_what_is_before_the_hand_and_over_it_counts(hand_scene):
    add_square(hand_scene, -0.3, "Wall")
    add_square(hand_scene, 0.2, "Screen")
    add_square(hand_scene, 0.2, "Aside").location.x = 3
    add_square(hand_scene, 0.3, "Unseen").visible_camera = False
    add_square(hand_scene, 0.9, "Behind the camera")
    camera, triangles = foreground(hand_scene)
    assert len(triangles) == 2
    depth = scene_depth(triangles, camera)
    assert depth.shape == (64, 48)
    covered = depth < DEPTH_BACKGROUND
    assert depth[covered] == pytest.approx(0.3, abs=1e-5)
    assert 0.5 < covered.mean() <= 1


def test_no_hand_has_no_foreground(hand_scene):
    for thing in list(bpy.data.objects):
        if thing.type != "CAMERA":
            bpy.data.objects.remove(thing)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert Foreground(depsgraph, set(), LocalTriangles()).before(depsgraph, LOOKS_ALONG_Z, []) == ()
    assert len(foreground_triangles((), LOOKS_ALONG_Z, [])) == 0
    assert np.all(scene_depth(np.zeros((0, 3, 3)), LOOKS_ALONG_Z) == DEPTH_BACKGROUND)


def test_a_hand_is_no_foreground_of_another(hand_scene):
    add_hand(bpy.context, load_default_hand(), name="Other").location.z = 0.2
    assert len(foreground(hand_scene)[1]) == 0


def test_triangles_that_reach_behind_the_camera_are_cut_there():
    floor = np.array([[[-9.0, 1, -5], [9, 1, -5], [0, 1, 5]], [[-1, 1, 2], [1, 1, 2], [0, 1, 4]], [[0, 0, -1]] * 3])
    parts = clipped(LOOKS_ALONG_Z, floor)
    assert len(parts) == 2
    assert parts[..., 2].min() >= 1e-3 - 1e-9
    depth = scene_depth(parts, LOOKS_ALONG_Z)
    # A floor 1 m below is seen at depth 1 / ((row - 15) / 40).
    rows = np.flatnonzero(depth[:, 20] < DEPTH_BACKGROUND)
    assert rows[-1] == 29
    assert depth[29, 20] == pytest.approx(40 / (29.5 - 15), rel=1e-3)
