"""The example shot: its contents, that the hand is always in the image, and that its script makes the same file."""

import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.hands.shot import read_shot
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.rig.hand import find_hands
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.scene.camera import read_camera

EXAMPLES = Path(__file__).parents[2] / "examples"
FRAMES = range(1, 25)
MARGIN_PX = 12


@pytest.fixture(autouse=True)
def _scripts_find_each_other(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)


@pytest.fixture
def scene():
    bpy.ops.wm.open_mainfile(filepath=str(EXAMPLES / "wave.blend"))
    return bpy.context.scene


def shots(scene):
    for frame in FRAMES:
        scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        (hand,) = visible_hands(depsgraph)
        camera = read_camera(scene.camera.evaluated_get(depsgraph), scene.render)
        yield read_shot(hand, depsgraph, camera, len(hand.mesh.data.vertices))


def keyframes(curves_of):
    """(type of object, channel, index) -> [K, 2] frames and values, of the open file."""
    curves = {}
    for thing in bpy.data.objects:
        for curve in curves_of(thing.animation_data.action) if thing.animation_data else ():
            points = np.array([point.co for point in curve.keyframe_points])
            curves[thing.type, curve.data_path, curve.array_index] = points
    return curves


def test_it_is_one_second_of_a_hand_set_up_for_livehand(scene):
    assert (scene.frame_start, scene.frame_end, scene.render.fps) == (FRAMES[0], FRAMES[-1], 24)
    assert (scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage) == (334, 512, 100)
    assert (scene.render.engine, scene.render.film_transparent, scene.render.dither_intensity) == ("LIVEHAND", True, 0)
    assert (scene.view_settings.view_transform, scene.view_settings.look) == ("Standard", "None")
    (hand,) = find_hands(scene)
    assert (hand.livehand.side, hand.livehand.model_path, hand.livehand.avatar_path) == ("right", "", "")
    assert hand.livehand.hair == 0.5


def test_it_contains_no_local_path_and_no_script(scene):
    assert not bpy.data.texts
    assert not bpy.data.libraries
    assert not bpy.data.images
    assert scene.render.filepath.startswith("//")


def test_the_whole_hand_is_in_the_picture_in_every_frame(scene):
    for shot in shots(scene):
        pixels, depth = shot.camera.project(shot.vertices[load_default_hand().framed_vertices])
        assert (depth > 0.5).all()
        assert pixels.min() > MARGIN_PX
        assert (pixels.max(0) < np.array(shot.camera.size_px) - MARGIN_PX).all()


def test_it_moves_in_every_frame_without_a_jump(scene):
    frames = list(shots(scene))
    views = np.array([shot.camera.cam2world for shot in frames])
    assert (np.abs(np.diff(views, axis=0)).max((1, 2)) > 1e-5).all()
    steps_m = np.linalg.norm(np.diff([shot.vertices for shot in frames], axis=0), axis=-1).max(-1)
    assert (steps_m > 1e-5).all()
    assert steps_m.max() < 0.05  # a finger tip's fastest frame


def test_it_closes_from_an_open_hand_to_a_fist(scene):
    def bend_deg(frame):
        scene.frame_set(frame)
        theta = read_hand_pose(find_hands(scene)[0], bpy.context.evaluated_depsgraph_get()).theta
        return np.rad2deg(np.linalg.norm(theta[1:], axis=-1)).sum()

    assert bend_deg(1) < 150
    assert bend_deg(24) > 900


def test_its_script_makes_the_same_keyframes(scene, curves_of):
    saved = keyframes(curves_of)
    bpy.ops.wm.read_homefile(use_empty=True)
    runpy.run_path(str(EXAMPLES / "make_wave.py"))["build_wave"]()
    made = keyframes(curves_of)
    assert saved.keys() == made.keys()
    assert len(saved) == 17 * 4 + 3 + 3 + 3 + 3
    for key, points in saved.items():
        np.testing.assert_allclose(made[key], points, atol=1e-6, err_msg=str(key))
