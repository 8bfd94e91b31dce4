"""The render engine through Blender's own operator: pixels, passes, border, layers, and errors that stop it."""

import shutil

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.render.progress import RenderStopped
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from PIL import Image


def render_png(scene, path):
    """[H, W, 4] levels of the frame Blender saves."""
    scene.render.filepath = str(path)
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    bpy.ops.render.render(write_still=True)
    return np.array(Image.open(path)).astype(int)


def expected_levels(frame):
    """The 8-bit straight sRGB of a frame."""
    alpha = frame.alpha[..., None]
    linear = np.divide(frame.rgb, alpha, out=np.zeros_like(frame.rgb), where=alpha > 0)
    srgb = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)
    return np.round(np.concatenate([srgb, alpha], -1) * 255).astype(int)


def last_shot(session):
    return session.made[-1].shots[-1]


def test_a_still_has_the_pixels_of_the_rendered_frame(hand_scene, fake_session, fake_renderer, tmp_path):
    png = render_png(hand_scene, tmp_path / "still.png")
    expected = expected_levels(fake_renderer().render(last_shot(fake_session)))
    solid = expected[..., 3] > 0
    assert png.shape == (64, 48, 4)
    assert np.abs(png - expected)[solid].max() == 0
    assert np.array_equal(png[..., 3], expected[..., 3])


def test_depth_is_written_as_a_pass(hand_scene, use_multilayer_exr, fake_session, read_exr, tmp_path):
    hand_scene.render.filepath = str(tmp_path / "still.exr")
    use_multilayer_exr(hand_scene)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "still.exr")
    depth, alpha = channels["ViewLayer.Depth.Z"], channels["ViewLayer.Combined.A"]
    assert np.all(depth[alpha == 0] == np.float32(DEPTH_BACKGROUND))
    assert depth[alpha > 0] == pytest.approx(0.5, abs=0.05)


def test_without_the_depth_pass_only_combined_is_written(
    hand_scene, use_multilayer_exr, fake_session, read_exr, tmp_path
):
    hand_scene.view_layers[0].use_pass_z = False
    hand_scene.render.filepath = str(tmp_path / "still.exr")
    use_multilayer_exr(hand_scene)
    bpy.ops.render.render(write_still=True)
    assert set(read_exr(tmp_path / "still.exr")) == {f"ViewLayer.Combined.{c}" for c in "RGBA"}


def test_animation_reads_each_frame_with_one_renderer(hand_scene, fake_session, tmp_path):
    armature = find_hands(hand_scene)[0]
    for frame in (1, 2, 3):
        armature.location.x = 0.01 * frame
        armature.keyframe_insert("location", frame=frame)
    hand_scene.frame_start, hand_scene.frame_end = 1, 3
    hand_scene.render.filepath = str(tmp_path / "f_")
    bpy.ops.render.render(animation=True)
    (renderer,) = fake_session.made
    moved = [shot.vertices[0, 0] - load_default_hand().v_template[0, 0] for shot in renderer.shots]
    assert moved == pytest.approx([0.01, 0.02, 0.03], abs=1e-6)
    assert len(list(tmp_path.glob("f_*.png"))) == 3


def test_percentage_scales_the_image(hand_scene, fake_session, tmp_path):
    hand_scene.render.resolution_percentage = 50
    assert render_png(hand_scene, tmp_path / "half.png").shape == (32, 24, 4)


@pytest.mark.parametrize("crop", [False, True])
def test_the_border_is_a_crop_of_the_whole_frame(hand_scene, fake_session, tmp_path, crop):
    whole = render_png(hand_scene, tmp_path / "whole.png")
    render = hand_scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.3, 0.8, 0.21, 0.62
    part = render_png(hand_scene, tmp_path / "part.png")
    columns, rows = slice(14, 38), slice(64 - 39, 64 - 13)
    assert last_shot(fake_session).camera.size_px == (24, 26)
    if not crop:
        assert part.shape == whole.shape
        part = part[rows, columns]
    assert np.array_equal(part[..., 3], whole[rows, columns, 3])
    seen = part[..., 3] > 0
    assert np.abs(part - whole[rows, columns])[seen].max() <= 1


def test_a_view_layer_without_the_hand_is_empty(hand_scene, use_multilayer_exr, fake_session, read_exr, tmp_path):
    hand_scene.view_layers.new("Other")
    collection = bpy.data.collections.new("Hand")
    hand_scene.collection.children.link(collection)
    for obj in (find_hands(hand_scene)[0], mesh_of(find_hands(hand_scene)[0])):
        for old in obj.users_collection:
            old.objects.unlink(obj)
        collection.objects.link(obj)
    hand_scene.view_layers["Other"].layer_collection.children["Hand"].exclude = True
    hand_scene.render.filepath = str(tmp_path / "layers.exr")
    use_multilayer_exr(hand_scene)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "layers.exr")
    assert channels["ViewLayer.Combined.A"].max() == 1
    assert channels["Other.Combined.A"].max() == 0


def test_stereo_gives_two_eyes(hand_scene, fake_session, tmp_path):
    hand_scene.render.use_multiview = True
    hand_scene.camera.data.stereo.interocular_distance = 0.06
    hand_scene.camera.data.stereo.convergence_mode = "OFFAXIS"
    hand_scene.camera.data.stereo.convergence_distance = 0.5
    bpy.ops.render.render()
    left, right = (shot.camera for shot in fake_session.made[-1].shots)
    assert right.origin - left.origin == pytest.approx([0.06, 0, 0], abs=1e-6)
    # Both eyes see the point of convergence in the middle of the image.
    middle = np.array([-0.08, 0, 0.0])
    for eye in (left, right):
        assert eye.project(middle)[0] == pytest.approx([24, 32], abs=1e-3)


def test_device_and_precision_are_the_scenes(hand_scene, fake_session):
    hand_scene.livehand.device, hand_scene.livehand.precision = "cpu", "bf16"
    bpy.ops.render.render()
    assert (fake_session.made[-1].device.name, fake_session.made[-1].device.precision) == ("cpu", "bf16")


def test_a_changed_avatar_file_is_loaded_again(hand_scene, fake_session, tmp_path):
    avatar = tmp_path / "mine.safetensors"
    shutil.copy(shipped_avatar_path("lena"), avatar)
    find_hands(hand_scene)[0].livehand.avatar_path = str(avatar)
    bpy.ops.render.render()
    bpy.ops.render.render()
    assert len(fake_session.made) == 1
    shutil.copy(shipped_avatar_path("mei"), avatar)
    bpy.ops.render.render()
    assert len(fake_session.made) == 2


def test_a_left_hand_has_a_left_pose(hand_scene, fake_session):
    mesh_of(find_hands(hand_scene)[0]).hide_render = True
    add_hand(bpy.context, load_default_hand().for_side("left"), name="Left")
    bpy.ops.render.render()
    assert last_shot(fake_session).pose.side == "left"
    # The renderer mirrors: it gets the model of its file, for either side.
    assert fake_session.made[-1].hand.side == "right"


def no_camera(scene):
    scene.camera = None


def panoramic(scene):
    scene.camera.data.type = "PANO"


def no_hand(scene):
    hand = find_hands(scene)[0]
    bpy.data.objects.remove(mesh_of(hand))
    bpy.data.objects.remove(hand)


def missing_avatar(scene):
    find_hands(scene)[0].livehand.avatar_path = "/nowhere/x.safetensors"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (no_camera, "camera"),
        (panoramic, "perspective and orthographic cameras only"),
        (no_hand, "needs a LiveHand hand"),
        (missing_avatar, "no file at"),
    ],
)
@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_an_error_stops_the_render_with_its_message(
    hand_scene, use_multilayer_exr, fake_session, tmp_path, spoil, message, suffix
):
    spoil(hand_scene)
    hand_scene.render.filepath = str(tmp_path / f"still.{suffix}")
    if suffix == "exr":
        use_multilayer_exr(hand_scene)
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.render.render(write_still=True)
    assert not list(tmp_path.iterdir())


def test_depth_of_field_of_an_orthographic_camera_is_an_error_with_a_remedy(hand_scene, fake_session, tmp_path):
    hand_scene.render.filepath = str(tmp_path / "still.png")
    lens = hand_scene.camera.data
    lens.type, lens.dof.use_dof = "ORTHO", True
    with pytest.raises(RuntimeError, match="turn its depth of field off"):
        bpy.ops.render.render(write_still=True)
    lens.dof.use_dof = False
    bpy.ops.render.render(write_still=True)
    assert fake_session.made[-1].shots[-1].camera.is_orthographic


def test_an_unexpected_exception_stops_an_animation(hand_scene, fake_session, fake_renderer, tmp_path, monkeypatch):
    def fail(self, shot, should_stop):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(fake_renderer, "render", fail)
    hand_scene.frame_end = 3
    hand_scene.render.filepath = str(tmp_path / "f_")
    with pytest.raises(RuntimeError, match="unexpected ZeroDivisionError: division by zero"):
        bpy.ops.render.render(animation=True)
    assert not list(tmp_path.iterdir())


def test_escape_is_no_error(hand_scene, fake_session, fake_renderer, monkeypatch):
    def stop(self, shot, should_stop):
        assert should_stop() is False  # without a window nobody can press Escape
        raise RenderStopped

    monkeypatch.setattr(fake_renderer, "render", stop)
    assert bpy.ops.render.render() == {"FINISHED"}


def test_panels_are_shown_and_hidden_with_the_engine(registered):
    from livehand.livehand_blender.render.panels import register_panels, unregister_panels

    panel = bpy.types.RENDER_PT_output
    assert LiveHandRender.bl_idname in panel.COMPAT_ENGINES
    unregister_panels()
    try:
        assert LiveHandRender.bl_idname not in panel.COMPAT_ENGINES
    finally:
        register_panels()
