"""Motion blur and depth of field: reading them from the scene, and rendering a moving hand."""

import bpy
import numpy as np
import pytest
from livehand.backend.image.exposure import SHARP
from livehand.livehand_blender.render.frame_setup import read_exposure, read_lens
from livehand.livehand_blender.rig.hand import find_hands


@pytest.fixture
def moving(hand_scene, curves_of):
    """The hand moves 2 cm a frame along x."""
    hand = find_hands(hand_scene)[0]
    for frame, x in ((0, -0.02), (2, 0.02)):
        hand.location.x = x
        hand.keyframe_insert("location", index=0, frame=frame)
    for curve in curves_of(hand.animation_data.action):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    hand_scene.render.use_motion_blur = True
    hand_scene.render.motion_blur_shutter = 0.5
    hand_scene.livehand.blur_samples = 4
    hand_scene.frame_set(1)
    return hand_scene


def test_a_sharp_frame_has_one_sample(hand_scene):
    assert read_exposure(hand_scene, None) == (SHARP,)


@pytest.mark.parametrize(
    ("position", "offsets"),
    [
        ("CENTER", [-0.1875, -0.0625, 0.0625, 0.1875]),
        ("START", [0.0625, 0.1875, 0.3125, 0.4375]),
        ("END", [-0.4375, -0.3125, -0.1875, -0.0625]),
    ],
)
def test_samples_are_spread_evenly_over_the_shutter(moving, position, offsets):
    moving.render.motion_blur_position = position
    samples = read_exposure(moving, None)
    assert sorted(sample.offset_frames for sample in samples) == pytest.approx(offsets)
    assert abs(samples[0].offset_frames) == min(abs(offset) for offset in offsets)
    assert {sample.lens for sample in samples} == {(0.0, 0.0)}


def test_the_lens_is_read_as_blender_defines_it(hand_scene):
    camera = hand_scene.camera
    assert read_lens(camera) is None
    camera.data.dof.use_dof, camera.data.lens = True, 80
    camera.data.dof.aperture_fstop, camera.data.dof.focus_distance = 2.0, 0.7
    assert (read_lens(camera).radius_m, read_lens(camera).focus_m) == pytest.approx((0.02, 0.7))
    target = bpy.data.objects.new("Target", None)
    target.location = (0.3, 0.2, 0.1)
    hand_scene.collection.objects.link(target)
    camera.data.dof.focus_object = target
    bpy.context.view_layer.update()
    assert read_lens(camera).focus_m == pytest.approx(0.4)  # along the axis: the camera stands at z = 0.5


def test_a_moving_hand_is_read_at_every_sample(moving, fake_session):
    bpy.ops.render.render()
    (renderer,) = fake_session.made
    x = sorted(shot.vertices[:, 0].mean() for shot in renderer.shots)
    assert len(x) == 4
    assert np.diff(x) == pytest.approx(np.full(3, 0.02 * 0.125), rel=1e-4)
    assert moving.frame_current == 1
    assert moving.frame_subframe == 0


def test_a_blurred_frame_is_the_mean_in_linear_light(
    moving, fake_session, fake_renderer, tmp_path, read_exr, use_multilayer_exr
):
    moving.render.filepath = str(tmp_path / "blur.exr")
    use_multilayer_exr(moving)
    bpy.ops.render.render(write_still=True)
    frames = [fake_renderer().render(shot) for shot in fake_session.made[0].shots]
    channels = read_exr(tmp_path / "blur.exr")
    np.testing.assert_allclose(channels["ViewLayer.Combined.A"], np.mean([f.alpha for f in frames], 0), atol=1e-6)
    np.testing.assert_allclose(channels["ViewLayer.Combined.R"], np.mean([f.rgb[..., 0] for f in frames], 0), atol=1e-6)
    soft = (channels["ViewLayer.Combined.A"] > 0.1) & (channels["ViewLayer.Combined.A"] < 0.9)
    assert soft.sum() > 20


def test_depth_of_field_renders_through_every_point_of_the_lens(hand_scene, fake_session):
    dof = hand_scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 1.4, 0.5
    hand_scene.livehand.blur_samples = 8
    bpy.ops.render.render()
    origins = np.array([shot.camera.origin for shot in fake_session.made[0].shots])
    assert len(np.unique(origins.round(9), axis=0)) == 8
    radius_m = hand_scene.camera.data.lens * 1e-3 / 2.8
    centre = np.array([-0.08, 0, 0.5])
    assert np.linalg.norm(origins - centre, axis=1).max() == pytest.approx(radius_m * np.sqrt(7.5 / 8))
