"""Images of views: composed, cropped, and at any scale in the same place."""

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.records.camera import Camera
from livehand.backend.records.frame import empty_frame
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.session import Session
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.render.viewport_hand import read_viewport_hands
from livehand.livehand_blender.render.viewport_image import ViewportRequest, ViewportStep, viewport_image
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from livehand.livehand_blender.scene.camera import read_camera


def view_space():
    """A 3D view's space; without a window Blender has one on its only screen, too."""
    areas = (area for window in bpy.context.window_manager.windows for area in window.screen.areas)
    return next(area.spaces.active for area in areas if area.type == "VIEW_3D")


def hands_in_view():
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return read_viewport_hands(view_space(), depsgraph, visible_hands(depsgraph))


def test_an_image_is_cropped_flipped_and_in_the_working_space():
    frame = empty_frame((8, 6))
    frame.alpha[1:3, 4:7] = 1
    frame.rgb[1, 4:7] = (0.5, 0, 0)
    frame.rgb[2, 4:7] = (0, 0.25, 0)
    swap = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    image = viewport_image(frame, 0.5, swap)
    assert image.box == (8, 2, 14, 6)
    assert image.rgba.shape == (2, 3, 4)
    assert image.rgba[0, 0] == pytest.approx([0.25, 0, 0, 1])
    assert image.rgba[1, 2] == pytest.approx([0, 0.5, 0, 1])


def test_an_empty_frame_has_no_image():
    assert viewport_image(empty_frame((8, 6)), 1.0, np.eye(3)) is None


@pytest.fixture
def hands(hand_scene):
    return hands_in_view()


def test_a_coarse_image_lies_where_the_full_one_does(hand_scene, hands, fake_renderer):
    hand_scene.render.resolution_x, hand_scene.render.resolution_y = 240, 320
    camera = read_camera(hand_scene.camera, hand_scene.render)
    request, session = ViewportRequest(hands, camera, np.eye(3, dtype=np.float32)), Session(fake_renderer)
    full, coarse = (request.render(session, scale, lambda: False) for scale in (1.0, 0.25))
    assert coarse.rgba.shape[0] < full.rgba.shape[0] / 3
    assert coarse.box == pytest.approx(full.box, abs=4)
    assert coarse.rgba.mean((0, 1)) == pytest.approx(full.rgba.mean((0, 1)), abs=0.02)
    assert coarse.rgba[0].mean(0) == pytest.approx(full.rgba[:4].mean((0, 1)), abs=0.05)


@pytest.mark.slow
def test_whole_frames_are_shown_at_full_size_as_the_cpu_shows_what_rests(hand_scene, hands):
    """Warp's CPU device in place of a GPU."""
    backend = pytest.importorskip("livehand.backend.compute.gpu.backend").WarpBackend("cpu")
    hand_scene.render.resolution_x, hand_scene.render.resolution_y = 96, 128
    camera = read_camera(hand_scene.camera, hand_scene.render)
    request = ViewportRequest(hands, camera, np.eye(3, dtype=np.float32))
    at_once, on_cpu = (
        Session(lambda path, hand, device, kind=kind: Renderer(load_avatar(path), hand, "cpu", "fp32", kind))
        for kind in (backend, None)
    )
    moving = ViewportStep(request, at_once, 0.25, 32, 1.0)(lambda: False)
    rests = ViewportStep(request, on_cpu, 1.0)(lambda: False)
    assert moving.is_at_once
    assert not rests.is_at_once
    assert moving.box == rests.box
    assert (np.abs(moving.rgba - rests.rgba) > 4e-3 * max(1, rests.rgba.max())).mean() < 0.02
    coarse = ViewportStep(request, on_cpu, 0.25, 32, 1.0)(lambda: False)
    assert not coarse.is_at_once
    assert len(coarse.rgba) < len(rests.rgba) / 2


def test_two_hands_are_in_one_image(hand_scene, hands, fake_renderer):
    bpy.ops.livehand.add_hand(side="left")
    bpy.context.object.location = (-0.06, 0.06, -0.1)
    both = hands_in_view()
    assert len(hands) == 1
    assert sorted(hand.pose.side for hand in both) == ["left", "right"]
    camera = read_camera(hand_scene.camera, hand_scene.render)
    one, two = (
        ViewportRequest(some, camera, np.eye(3, dtype=np.float32)).render(Session(fake_renderer), 1.0, lambda: False)
        for some in (hands, both)
    )
    assert two.rgba[..., 3].sum() > one.rgba[..., 3].sum()


def test_a_hidden_hand_is_not_read_and_no_hand_gives_no_image(hand_scene, fake_renderer):
    mesh_of(find_hands(hand_scene)[0]).hide_set(True)
    none = hands_in_view()
    assert none == ()
    camera = Camera(np.eye(3), np.eye(4), (4, 4))
    assert ViewportRequest(none, camera, np.eye(3)).render(Session(fake_renderer), 1.0, lambda: False) is None
