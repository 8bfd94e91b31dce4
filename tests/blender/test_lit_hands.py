"""The scene's light on its way to the renderers: read once a frame, for the hands that take it."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.frame import Frame
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.render import frame_setup
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.render.keep_look import in_scene_colours
from livehand.livehand_blender.render.viewport_hand import read_viewport_hands
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands
from livehand.livehand_blender.scene.camera import read_camera


@pytest.fixture
def lit_scene(hand_scene, fake_session, fake_renderer, monkeypatch):
    """The hand under a lamp and a plain world, with a renderer that takes light."""
    monkeypatch.setattr(fake_renderer, "is_relightable", True)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.location, lamp.data.energy = (0, 0, 1), 20
    hand_scene.collection.objects.link(lamp)
    hand_scene.world = bpy.data.worlds.new("Grey")
    return hand_scene


def hands_in(space):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return read_viewport_hands(space, depsgraph, visible_hands(depsgraph))


def rendered_shots(scene, session, tmp_path):
    scene.render.filepath = str(tmp_path / "still.png")
    bpy.ops.render.render(write_still=True)
    return session.made[-1].shots


def test_a_still_has_the_scenes_light(lit_scene, fake_session, tmp_path):
    (shot,) = rendered_shots(lit_scene, fake_session, tmp_path)
    assert [lamp.kind for lamp in shot.light.lamps] == ["point"]
    np.testing.assert_allclose(shot.light.lamps[0].rgb, 20, rtol=0.01)
    assert shot.light.sky is not None


def test_the_captures_own_light(lit_scene, fake_session, tmp_path):
    lit_scene.livehand.light = "CAPTURE"
    assert rendered_shots(lit_scene, fake_session, tmp_path)[0].light is None


def test_light_is_not_read_for_baked_avatars(lit_scene, fake_session, fake_renderer, monkeypatch, tmp_path):
    monkeypatch.setattr(fake_renderer, "is_relightable", False)
    monkeypatch.setattr(frame_setup, "read_hand_lights", None)
    assert rendered_shots(lit_scene, fake_session, tmp_path)[0].light is None


def test_light_is_read_once_for_all_hands_and_samples(lit_scene, fake_session, monkeypatch, tmp_path):
    add_hand(bpy.context, load_default_hand(), name="Other").location = (0, 0, 0.1)
    lit_scene.render.use_motion_blur, lit_scene.livehand.blur_samples = True, 3
    armature = find_hands(lit_scene)[0]
    for frame in (0, 2):
        armature.location.x = 0.02 * frame
        armature.keyframe_insert("location", frame=frame)
    calls, read = [], frame_setup.read_hand_lights
    monkeypatch.setattr(
        frame_setup, "read_hand_lights", lambda *args, **kwargs: calls.append(args) or read(*args, **kwargs)
    )
    shots = rendered_shots(lit_scene, fake_session, tmp_path)
    assert len(calls) == 1
    assert len(shots) == 6
    assert len({id(shot.light) for shot in shots}) == 2
    assert all(len(shot.light.occluders) > 0 for shot in shots)


def test_a_view_has_the_scenes_light(lit_scene, fake_session):
    areas = [area for screen in bpy.data.screens for area in screen.areas]
    space = next(area.spaces.active for area in areas if area.type == "VIEW_3D")
    (hand,) = hands_in(space)
    task = hand.task(LiveHandRender.required_session(), read_camera(lit_scene.camera, lit_scene.render))
    assert [lamp.kind for lamp in task.shot.light.lamps] == ["point"]
    lit_scene.livehand.light = "CAPTURE"
    (hand,) = hands_in(space)
    assert hand.light is None


def test_keep_look_is_off_for_a_lit_hand():
    scene = bpy.context.scene
    scene.livehand.keep_look, scene.view_settings.view_transform = True, "AgX"
    ones = np.ones((2, 2), np.float32)
    frame = Frame(np.full((2, 2, 3), 4.0, np.float32), ones, ones, is_lit=True)
    np.testing.assert_array_equal(in_scene_colours(frame, scene).rgb, frame.rgb)
    assert in_scene_colours(replace(frame, is_lit=False), scene).rgb.max() != 4


def open_again(path, **changes):
    for name, value in changes.items():
        setattr(bpy.context.scene.livehand, name, value)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene.livehand


def test_new_files_are_lit_by_their_scene(hand_scene, tmp_path):
    assert hand_scene.livehand.light == "SCENE"
    assert open_again(tmp_path / "new.blend").light == "SCENE"
    assert open_again(tmp_path / "new.blend", light="CAPTURE").light == "CAPTURE"
