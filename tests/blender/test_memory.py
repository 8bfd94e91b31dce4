"""Loaded avatars are freed on demand, and after a render in a window."""

import bpy
import pytest
from livehand.livehand_blender.render import memory
from livehand.livehand_blender.render.engine import LiveHandRender


@pytest.fixture
def windowed(registered, monkeypatch):
    """Renders are watched as they are with a window."""

    class App:
        background = False
        handlers, version = bpy.app.handlers, bpy.app.version

    monkeypatch.setattr(memory.bpy, "app", App)
    memory.watch_renders()
    yield
    memory.stop_watching()


def test_the_operator_frees_loaded_avatars(hand_scene, fake_session):
    bpy.ops.render.render()
    bpy.ops.render.render()
    assert len(fake_session.made) == 1
    bpy.ops.livehand.free_memory()
    bpy.ops.render.render()
    assert len(fake_session.made) == 2


def test_without_a_window_renders_are_not_watched(registered):
    assert not any(handler.__module__ == memory.__name__ for handler in bpy.app.handlers.render_complete)


@pytest.mark.parametrize(("wanted", "renderers"), [(True, 2), (False, 1)])
def test_after_a_render_in_a_window(hand_scene, fake_session, windowed, wanted, renderers):
    hand_scene.livehand.free_after_render = wanted
    bpy.ops.render.render()
    bpy.ops.render.render()
    assert len(fake_session.made) == renderers


def test_after_a_render_avatars_that_a_view_shows_are_kept(hand_scene, fake_session, windowed):
    (space,) = [
        area.spaces.active for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D"
    ]
    bpy.ops.render.render()
    space.shading.type = "RENDERED"
    try:
        bpy.ops.render.render()
        bpy.ops.render.render()
        assert len(fake_session.made) == 2
    finally:
        space.shading.type = "SOLID"
    bpy.ops.render.render()
    bpy.ops.render.render()
    assert len(fake_session.made) == 3


def test_an_animation_loads_once(hand_scene, fake_session, windowed, tmp_path):
    hand_scene.frame_end = 3
    hand_scene.render.filepath = str(tmp_path / "f_")
    bpy.ops.render.render(animation=True)
    assert len(fake_session.made) == 1
    assert fake_session is LiveHandRender.hands_session
