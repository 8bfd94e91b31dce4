"""Drawing into 3D views, read back from an off-screen buffer: place, orientation, blending, messages, and updates."""

import time
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.render.preview_scheduler import StepOutcome
from livehand.backend.system.child_job import JobProgress
from livehand.livehand_blender.hands import visible_hands
from livehand.livehand_blender.render import viewport as viewport_module
from livehand.livehand_blender.render.viewport import (
    FreeArea,
    ImageTexture,
    Pace,
    UploadedImages,
    Viewport,
    draw_message,
    free_area,
)
from livehand.livehand_blender.render.viewport_image import ViewportImage, ViewportStep
from livehand.livehand_blender.render.viewport_shared import ViewportShared
from livehand.livehand_blender.render.viewport_view import Rectangle
from livehand.livehand_blender.rig.hand import find_hands
from mathutils import Matrix

SIZE_PX = (160, 120)
GROUND = 0.25


@pytest.fixture(scope="module", autouse=True)
def gpu_context(registered):
    """Blender without a window has a GPU context once something that needs one has been rendered."""
    render = bpy.context.scene.render
    bpy.context.scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(bpy.context.scene.camera)
    render.engine, render.resolution_x, render.resolution_y = "BLENDER_WORKBENCH", 16, 16
    render.resolution_percentage, render.use_border = 100, False  # whatever tests of another module left
    bpy.ops.render.render()


def forget_the_last_drawing():
    """In Blender 4.2 without a window, the state of an earlier drawing would hide everything."""
    gpu.state.depth_test_set("NONE")
    gpu.state.face_culling_set("NONE")
    gpu.state.color_mask_set(True, True, True, True)
    gpu.state.viewport_set(0, 0, *SIZE_PX)


@pytest.fixture
def drawn():
    """A function: draw into a grey region and give its pixels [H, W, 4], top row first."""

    def of(draw):
        width, height = SIZE_PX
        offscreen = gpu.types.GPUOffScreen(width, height, format="RGBA32F")
        try:
            with offscreen.bind(), gpu.matrix.push_pop():
                buffer = gpu.state.active_framebuffer_get()
                buffer.clear(color=(GROUND, GROUND, GROUND, 1.0))
                gpu.matrix.load_matrix(Matrix.Identity(4))
                pixels_to_device = Matrix.Diagonal((2 / width, 2 / height, 1, 1))
                pixels_to_device.translation = (-1, -1, 0)
                gpu.matrix.load_projection_matrix(pixels_to_device)
                forget_the_last_drawing()
                draw()
                pixels = buffer.read_color(0, 0, width, height, 4, 0, "FLOAT")
                pixels.dimensions = width * height * 4
                return np.array(pixels, np.float32).reshape(height, width, 4)[::-1]
        finally:
            offscreen.free()

    return of


def test_an_image_is_drawn_upright_in_its_box_over_the_view(drawn):
    rgba = np.zeros((2, 3, 4), np.float32)
    rgba[0] = (0.5, 0, 0, 0.5)  # the bottom row
    rgba[1] = (0, 1, 0, 1)
    texture = ImageTexture(ViewportImage(rgba, (10.0, 20.0, 13.0, 22.0)))
    assert texture.upload(0.0)
    pixels = drawn(lambda: texture.draw(Rectangle(40, 30, 140, 110), SIZE_PX[1]))
    assert pixels[50, 50:53, :3] == pytest.approx(np.array([[0, 1, 0]] * 3), abs=1e-3)
    assert pixels[51, 50:53, :3] == pytest.approx(np.array([[0.5 + GROUND / 2, GROUND / 2, GROUND / 2]] * 3), abs=1e-3)
    pixels[50:52, 50:53] = pixels[0, 0]
    assert np.all(pixels[..., :3] == GROUND)


@pytest.mark.parametrize("box", [(10.0, 5.0, 50.0, 35.0), (10.25, 5.5, 90.0, 64.0)], ids=["as it is", "enlarged"])
@pytest.mark.parametrize("rows", [1, 7, 29])
def test_an_image_in_bands_is_drawn_as_one_in_one(drawn, monkeypatch, rows, box):
    """Where bands meet, filters mix the same neighbours; in single precision, a byte of two pixels may differ."""
    rgba = np.random.default_rng(0).uniform(0, 1, (30, 40, 4)).astype(np.float32)
    whole, banded = (ImageTexture(ViewportImage(rgba, box)) for _ in range(2))
    assert whole.upload(0.0)
    monkeypatch.setattr(viewport_module, "BAND_PX", 40 * rows)
    banded = ImageTexture(ViewportImage(rgba, box))
    uploads = 1
    while not banded.upload(0.0):
        uploads += 1
    assert uploads == -(-30 // rows)
    one, other = (
        drawn(lambda texture=texture: texture.draw(Rectangle(0, 0, *SIZE_PX), SIZE_PX[1]))
        for texture in (whole, banded)
    )
    assert np.ptp(one) > 0.5
    np.testing.assert_allclose(one, other, atol=1 / 255)
    if box[2] - box[0] == 40:
        expected = rgba[::-1, :, :3] + (1 - rgba[::-1, :, 3:]) * GROUND
        np.testing.assert_allclose(one[5:35, 10:50, :3], expected, atol=2e-3)


def test_an_image_is_uploaded_by_parts_while_the_one_before_is_shown(drawn, monkeypatch):
    monkeypatch.setattr(viewport_module, "BAND_PX", 4 * 10)
    monkeypatch.setattr(viewport_module, "_LONGEST_S", -1.0)
    first, second, third, fourth = (
        ViewportImage(np.full((20, 10, 4), k, np.float32), (0, 0, 10, 20)) for k in range(4)
    )
    images = UploadedImages()
    images.add(first)
    for _ in range(4):
        assert images.upload()
        assert images.shown is None
    assert not images.upload()
    assert images.shown.image is first
    images.add(second)
    assert images.upload()
    images.add(third)
    images.add(fourth)  # the one between is never shown; that which is half there is
    assert images.shown.image is first
    for image in (second, fourth):
        while images.shown.image is not image:
            assert images.is_uploading
            images.upload()
    assert not images.is_uploading
    images.add(first)
    images.clear(is_empty=True)
    assert images.shown is None
    assert images.is_empty
    assert not images.upload()
    images.add(second)
    assert images.upload()
    assert images.is_empty  # until another is there
    while images.upload():
        pass
    assert not images.is_empty


def test_the_timer_redraws_views_until_their_images_are_whole(shared):
    tags, view = [], type("View", (), {"is_uploading": True})()
    engine = type("Tagged", (), {"tag_redraw": lambda self: tags.append(1)})()
    shared.timer.watch(view, engine)
    for _ in range(3):
        assert shared.timer._callback() is not None
    assert len(tags) == 3
    view.is_uploading = False
    assert shared.timer._callback() is None
    assert len(tags) == 3
    shared.timer.stop()


def test_a_long_message_is_wrapped_into_the_region(drawn):
    area = FreeArea(0.0, SIZE_PX[0], SIZE_PX[1] + 80.0)  # its top is not drawn
    pixels = drawn(lambda: draw_message("the hand cannot be shown because of this and that " * 2, area, 1.0))
    rows, columns = np.nonzero(np.abs(pixels[..., 0] - GROUND) > 0.01)
    assert pixels[..., 0].max() > 0.5
    assert columns.min() > 0
    assert columns.max() < area.right - 1
    assert rows.min() < 40  # below what Blender writes there
    assert rows.max() > 60


@pytest.mark.parametrize("is_overlapping", [True, False])
def test_messages_avoid_the_regions_that_cover_the_view(context, monkeypatch, is_overlapping):
    def region(kind, x, y, width, height, alignment="TOP"):
        return SimpleNamespace(type=kind, x=x, y=y, width=width, height=height, alignment=alignment)

    regions = [region("TOOLS", 100, 50, 40, 500), region("UI", 700, 50, 200, 500), region("HEADER", 100, 640, 800, 30)]
    hidden = [region("TOOL_HEADER", 100, 1, 800, 1), region("HEADER", 100, 50, 800, 30, "BOTTOM")]
    context.region = region("WINDOW", 100, 50, 800, 620)
    context.area = SimpleNamespace(regions=[*regions, *hidden, context.region])
    system = SimpleNamespace(use_region_overlap=is_overlapping)
    context.preferences = SimpleNamespace(system=system)
    assert free_area(context) == ((40, 600, 590) if is_overlapping else (0, 800, 620))


def test_while_kernels_are_prepared_the_view_says_so_and_renders_nothing(drawn, context, shared, messages):
    progress = [JobProgress("Preparing LiveHand (once): 40 of 171", 0.23)]
    shared.preparation = SimpleNamespace(progress=progress[0])
    viewport = Viewport(shared)
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert set(messages) == {"LiveHand: Preparing LiveHand (once): 40 of 171"}
    assert not viewport.has_image
    assert shared.session.made == []
    shared.preparation = SimpleNamespace(progress=None)
    drawn(lambda: show(viewport, Engine(), context, shared))
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert viewport.has_image


def test_a_view_says_when_it_waits_for_a_person_of_numbers(drawn, context, shared, messages):
    viewport = Viewport(shared)
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert messages == ["LiveHand: loading the avatar"]
    find_hands(bpy.context.scene)[0].livehand.avatar_path = str(shipped_avatar_path("amara"))
    before = ViewportStep(viewport._submitted[0], shared.session, 1.0)
    shared.preview._outcomes[viewport] = StepOutcome(before, 0.1, None, None)  # arrives only now
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert messages[1:] == ["LiveHand: loading Amara: at first use, the skin is drawn in some 20 seconds"]
    assert viewport.has_image
    find_hands(bpy.context.scene)[0].location.x += 0.001
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert len(messages) == 2


def test_a_view_that_moves_on_while_it_loads_shows_the_image_of_before(drawn, context, shared, messages):
    viewport, engine = Viewport(shared), Engine()

    def draw():
        depsgraph = bpy.context.evaluated_depsgraph_get()
        viewport.update(context, depsgraph)
        viewport.draw(engine, context, depsgraph)

    drawn(draw)
    wait(shared, viewport)
    find_hands(bpy.context.scene)[0].location.x += 0.001
    drawn(draw)
    assert messages == ["LiveHand: loading the avatar"]
    assert viewport.has_image


def test_a_view_without_light_says_what_to_press(drawn, context, shared, messages):
    viewport, lamp = Viewport(shared), bpy.data.objects["Sun"]
    lamp.hide_render = True
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert "press Studio Lights" in messages[-1]
    assert viewport.has_image
    messages.clear()
    lamp.hide_render = False
    bpy.context.view_layer.update()
    viewport.update(context, bpy.context.evaluated_depsgraph_get())
    drawn(lambda: show(viewport, Engine(), context, shared))
    assert [text for text in messages if "Studio" in text] == []


@pytest.fixture
def messages(monkeypatch):
    """What views write, as it is written."""
    found = []
    monkeypatch.setattr(viewport_module, "draw_message", lambda text, area, scale: found.append(text))
    return found


class Engine:
    """Counts the redraws asked for."""

    def __init__(self):
        self.redraws = 0

    def tag_redraw(self):
        self.redraws += 1


@pytest.fixture
def shared(fake_session):
    made = ViewportShared(fake_session)
    yield made
    made.close()


@pytest.fixture
def context(hand_scene):
    """The hand from before, in a free perspective view, and a sun."""
    hand_scene.collection.objects.link(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    bpy.context.view_layer.update()
    camera, depsgraph = hand_scene.camera, bpy.context.evaluated_depsgraph_get()
    view = SimpleNamespace(
        window_matrix=camera.calc_matrix_camera(depsgraph, x=SIZE_PX[0], y=SIZE_PX[1]),
        view_matrix=camera.matrix_world.inverted(),
        view_perspective="PERSP",
    )
    areas = (area for window in bpy.context.window_manager.windows for area in window.screen.areas)
    space = next(area.spaces.active for area in areas if area.type == "VIEW_3D")
    return SimpleNamespace(
        region=SimpleNamespace(width=SIZE_PX[0], height=SIZE_PX[1]),
        area=SimpleNamespace(regions=[]),
        region_data=view,
        space_data=space,
        scene=hand_scene,
        screen=SimpleNamespace(is_animation_playing=False),
        preferences=bpy.context.preferences,
    )


def wait(shared, view):
    end = time.monotonic() + 10
    while shared.preview.is_busy(view):
        assert time.monotonic() < end
        time.sleep(0.001)


def show(viewport, engine, context, shared):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    viewport.update(context, depsgraph)
    viewport.draw(engine, context, depsgraph)
    wait(shared, viewport)
    shared.timer._callback()
    viewport.draw(engine, context, depsgraph)


def test_the_hand_is_drawn_in_place_and_rendered_only_when_something_changes(drawn, context, shared, fake_session):
    viewport, engine = Viewport(shared), Engine()
    drawn(lambda: show(viewport, engine, context, shared))
    assert engine.redraws == 1
    pixels = drawn(lambda: viewport.draw(engine, context, bpy.context.evaluated_depsgraph_get()))
    (renderer,) = fake_session.made
    frame = renderer.render(renderer.shots[-1])
    expected = frame.rgb + (1 - frame.alpha[..., None]) * GROUND
    assert frame.alpha.max() == 1
    assert pixels[..., :3] == pytest.approx(expected, abs=2e-3)  # half floats
    assert [shot.camera.size_px for shot in renderer.shots[:2]] == [SIZE_PX, SIZE_PX]
    count = len(renderer.shots)
    drawn(lambda: show(viewport, engine, context, shared))
    assert len(renderer.shots) == count
    find_hands(context.scene)[0].location.x += 0.02
    drawn(lambda: show(viewport, engine, context, shared))
    assert len(renderer.shots) == count + 2
    moved = renderer.shots[-1].vertices - renderer.shots[0].vertices
    assert moved[:, 0] == pytest.approx(0.02, abs=1e-6)


def test_the_hands_of_a_step_are_read_once(drawn, context, shared, monkeypatch):
    """Hidden from Cycles' camera at the update, and drawn afterwards."""
    viewport, engine, readings, read = Viewport(shared), Engine(), [], visible_hands._hand_instances
    monkeypatch.setattr(visible_hands, "_hand_instances", lambda depsgraph: readings.append(1) or read(depsgraph))

    def step():
        depsgraph = bpy.context.evaluated_depsgraph_get()
        viewport.update(context, depsgraph)
        meshes.append([mesh.name for mesh in viewport.hand_meshes(depsgraph)])
        viewport.draw(engine, context, depsgraph)

    meshes = []
    for x in (0.0, 0.01):
        find_hands(context.scene)[0].location.x = x
        drawn(step)
    assert meshes == [["LiveHand Mesh"]] * 2
    assert len(readings) == 2


def test_what_stands_before_the_hand_hides_it(drawn, context, shared):
    screen = bpy.data.meshes.new("Screen")
    screen.from_pydata([(-1, -1, 0.2), (1, -1, 0.2), (0, 1, 0.2)], [], [(0, 1, 2)])
    context.scene.collection.objects.link(bpy.data.objects.new("Screen", screen))
    bpy.context.view_layer.update()
    viewport, engine = Viewport(shared), Engine()
    drawn(lambda: show(viewport, engine, context, shared))
    pixels = drawn(lambda: viewport.draw(engine, context, bpy.context.evaluated_depsgraph_get()))
    assert np.all(pixels[..., :3] == GROUND)


def test_the_mesh_stands_for_the_hand_until_there_is_an_image_and_where_it_cannot_be_rendered(drawn, context, shared):
    viewport, engine, tagged, is_held = Viewport(shared), Engine(), [], [True]
    shared.timer.update_meshes = lambda: tagged.append((viewport.has_image, viewport.has_failed))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shared.preview.submit("other view", [stay_until(is_held)])
    viewport.update(context, depsgraph)
    drawn(lambda: viewport.draw(engine, context, depsgraph))
    assert not viewport.has_image
    assert not viewport.has_failed
    is_held.clear()
    drawn(lambda: show(viewport, engine, context, shared))
    assert viewport.has_image
    broken_hand(context)
    viewport.update(context, depsgraph)
    drawn(lambda: viewport.draw(engine, context, depsgraph))
    assert tagged == [(True, False), (False, True)]


@pytest.fixture
def wide(context):
    """The context with a region of 1024 x 768 px."""
    context.region.width, context.region.height = 1024, 768
    return context


def sizes_px(session):
    return [shot.camera.size_px for shot in session.made[0].shots]


def test_a_coarse_image_comes_before_the_full_one(drawn, wide, shared, fake_session):
    drawn(lambda: show(Viewport(shared), Engine(), wide, shared))
    assert sizes_px(fake_session) == [(256, 192), (1024, 768)]


def test_a_renderer_of_whole_frames_gives_a_final_image_of_the_full_size_for_every_change(
    drawn, wide, shared, fake_session, fake_renderer, monkeypatch
):
    monkeypatch.setattr(fake_renderer, "renders_at_once", True)
    viewport, engine, hand = Viewport(shared), Engine(), find_hands(wide.scene)[0]
    drawn(lambda: show(viewport, engine, wide, shared))
    assert set(sizes_px(fake_session)) == {(1024, 768)}
    before = len(sizes_px(fake_session))
    for number, is_playing in ((1, False), (2, True)):
        hand.location.x += 0.01
        wide.screen.is_animation_playing = is_playing
        drawn(lambda: show(viewport, engine, wide, shared))
        assert sizes_px(fake_session)[before:] == [(1024, 768)] * number
    assert {shot.quality for shot in fake_session.made[0].shots} == {"final"}


def test_whole_frames_that_do_not_keep_pace_are_coarse_while_something_moves(
    drawn, wide, shared, fake_session, fake_renderer, monkeypatch
):
    monkeypatch.setattr(fake_renderer, "renders_at_once", True)
    viewport, engine, hand = Viewport(shared), Engine(), find_hands(wide.scene)[0]
    viewport._pace = Pace(wanted_s=1e-9)
    wide.screen.is_animation_playing = True
    for _ in range(4):
        hand.location.x += 0.01
        drawn(lambda: show(viewport, engine, wide, shared))
    assert sizes_px(fake_session) == [(1024, 768)] * 3 + [(256, 192)]
    wide.screen.is_animation_playing = False
    drawn(lambda: show(viewport, engine, wide, shared))
    assert sizes_px(fake_session)[4:] == [(256, 192), (1024, 768)]


def test_while_an_animation_plays_only_coarse_images_are_rendered(drawn, wide, shared, fake_session):
    wide.screen.is_animation_playing = True
    viewport, engine = Viewport(shared), Engine()
    drawn(lambda: show(viewport, engine, wide, shared))
    assert sizes_px(fake_session) == [(256, 192)]
    wide.screen.is_animation_playing = False
    drawn(lambda: show(viewport, engine, wide, shared))
    assert sizes_px(fake_session)[1:] == [(256, 192), (1024, 768)]


def test_coarse_images_keep_pace_and_a_change_of_size_alone_renders_nothing(drawn, wide, shared, fake_session):
    viewport, engine = Viewport(shared), Engine()
    monotonous = iter(np.linspace(0.001, 0.002, 3))

    def show_moved():
        find_hands(wide.scene)[0].location.x += next(monotonous)
        show(viewport, engine, wide, shared)

    viewport._pace = Pace(wanted_s=1e-9)  # nothing is as fast
    wide.screen.is_animation_playing = True
    for _ in range(3):
        drawn(show_moved)
    assert sizes_px(fake_session) == [(256, 192)] * 3
    assert viewport._pace.side_px == 128
    drawn(lambda: show(viewport, engine, wide, shared))
    assert len(sizes_px(fake_session)) == 3
    wide.screen.is_animation_playing = False
    drawn(lambda: show(viewport, engine, wide, shared))
    assert sizes_px(fake_session)[3:] == [(128, 96), (1024, 768)]


def test_of_the_frames_of_an_animation_only_those_are_read_that_are_shown(drawn, context, shared, monkeypatch):
    context.screen.is_animation_playing = True
    viewport, engine, is_held, read = Viewport(shared), Engine(), [True], []
    reading = viewport_module.read_viewport_hands
    monkeypatch.setattr(
        viewport_module, "read_viewport_hands", lambda *args: read.append(hand.location.x) or reading(*args)
    )
    hand = find_hands(context.scene)[0]
    shared.preview.submit("other view", [stay_until(is_held)])

    def play(x):
        hand.location.x = x
        depsgraph = bpy.context.evaluated_depsgraph_get()
        viewport.update(context, depsgraph)
        viewport.draw(engine, context, depsgraph)

    for x in (0.0, 0.25, 0.5):
        drawn(lambda x=x: play(x))
    assert read == [0.0]
    is_held.clear()
    wait(shared, viewport)
    drawn(lambda: viewport.draw(engine, context, bpy.context.evaluated_depsgraph_get()))
    assert read == [0.0, 0.5]


def test_the_last_image_stays_until_the_next_is_there(drawn, context, shared):
    viewport, engine, is_held = Viewport(shared), Engine(), [True]
    drawn(lambda: show(viewport, engine, context, shared))
    before = drawn(lambda: viewport.draw(engine, context, bpy.context.evaluated_depsgraph_get()))
    shared.preview.submit("other view", [stay_until(is_held)])
    find_hands(context.scene)[0].location.x += 0.02
    depsgraph = bpy.context.evaluated_depsgraph_get()
    viewport.update(context, depsgraph)
    meanwhile = drawn(lambda: viewport.draw(engine, context, depsgraph))
    assert shared.preview.is_waiting(viewport)
    assert viewport.has_image
    np.testing.assert_array_equal(meanwhile, before)
    assert np.ptp(before[..., :3]) > 0.1
    is_held.clear()
    wait(shared, viewport)
    assert not np.array_equal(drawn(lambda: viewport.draw(engine, context, depsgraph)), before)


def test_a_view_that_turns_does_not_read_the_scene_again(drawn, context, shared, monkeypatch):
    reads = []
    reading = viewport_module.Foreground
    monkeypatch.setattr(viewport_module, "Foreground", lambda *args: reads.append(1) or reading(*args))
    viewport, engine = Viewport(shared), Engine()
    drawn(lambda: show(viewport, engine, context, shared))
    context.region_data.view_matrix = Matrix.Translation((0.01, 0, 0)) @ context.region_data.view_matrix
    drawn(lambda: viewport.draw(engine, context, bpy.context.evaluated_depsgraph_get()))
    assert shared.preview.is_busy(viewport)
    assert reads == [1]


def test_all_is_fine_once_the_hand_rests(drawn, wide, shared, fake_session, fake_renderer, monkeypatch):
    monkeypatch.setattr(fake_renderer, "is_relightable", True)
    drawn(lambda: show(Viewport(shared), Engine(), wide, shared))
    shots = fake_session.made[0].shots
    assert [shot.light.shadow_quality for shot in shots] == ["none", "fine"]
    assert [shot.quality for shot in shots] == ["preview", "final"]


def missing_avatar(context):
    find_hands(context.scene)[0].livehand.avatar_path = "/missing.safetensors"


def broken_hand(context):
    bone = find_hands(context.scene)[0].pose.bones[3]
    bone.name = "renamed"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(missing_avatar, "no file at"), (broken_hand, "must keep its bones' names")],
)
def test_errors_are_shown_in_the_view(drawn, context, shared, messages, spoil, words):
    spoil(context)
    viewport = Viewport(shared)
    pixels = drawn(lambda: show(viewport, Engine(), context, shared))
    assert words in messages[-1]
    assert viewport.has_failed
    assert np.all(pixels[..., :3] == GROUND)


def test_the_timer_runs_while_images_are_awaited_and_forgets_closed_views(shared):
    engine, is_open, view = Engine(), [True], type("View", (), {"is_uploading": False})()
    shared.preview.submit(view, [lambda stop: time.sleep(0.001) if is_open else None, stay_until(is_open)])
    shared.timer.watch(view, engine)
    assert bpy.app.timers.is_registered(shared.timer._callback)
    assert shared.timer._callback() is not None
    del engine
    assert shared.timer._callback() is None
    assert not shared.preview.is_busy(view)
    is_open.clear()
    shared.timer.stop()
    assert not bpy.app.timers.is_registered(shared.timer._callback)


def stay_until(is_open):
    def step(should_stop):
        while is_open and not should_stop():
            time.sleep(0.001)

    return step
