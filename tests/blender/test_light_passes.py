"""Cycles' light passes of the bare hand, measured in the middle of a frame's render."""

import bpy
import numpy as np
import pytest
from mathutils import Vector

SUN = Vector((0.3, -0.2, 1.0)).normalized()


@pytest.fixture
def lit_scene(hand_scene, fake_session, fake_renderer, monkeypatch):
    """The hand, palm up, in its scene under a sun of 3 W/m^2, before a camera that looks down at it."""
    monkeypatch.setattr(fake_renderer, "is_relightable", True, raising=False)
    scene = hand_scene
    scene.livehand.mode = "SCENE"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = 96, 128
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 3.0, 0.0
    sun.rotation_euler = SUN.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(sun)
    return scene


@pytest.fixture
def shots(fake_session, tmp_path):
    """A function: scene -> what was rendered of each hand."""

    def of(scene):
        scene.render.filepath = str(tmp_path / "still.png")
        bpy.ops.render.render(write_still=True)
        return fake_session.made[-1].shots

    return of


def depth_and_normal(scene, tmp_path, read_exr, use_multilayer_exr):
    """[H, W, 3] normals of the hand's mesh at the middle of pixels, and where there is any, by Cycles alone."""
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    layer = scene.view_layers[0]
    layer.use_pass_normal = True
    scene.cycles.samples = 16
    use_multilayer_exr(scene)
    scene.render.filepath = str(tmp_path / "normal.exr")
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "normal.exr")
    normal = np.stack([channels[f"{layer.name}.Normal.{c}"] for c in "XYZ"], -1)
    return normal, channels[f"{layer.name}.Combined.A"]


def test_a_sun_is_measured(lit_scene, shots, tmp_path, read_exr, use_multilayer_exr):
    (shot,) = shots(lit_scene)
    measured = shot.light.measured
    assert measured.alpha.shape == (64, 48)
    normal, alpha = depth_and_normal(lit_scene, tmp_path, read_exr, use_multilayer_exr)
    halves = alpha.reshape(64, 2, 48, 2).mean((1, 3))
    np.testing.assert_allclose(measured.alpha, halves, atol=0.25)
    assert np.abs(measured.alpha - halves).mean() < 0.02
    facing = np.clip(normal @ np.array(SUN), 0, None) * 3 / np.pi
    expected = facing.reshape(64, 2, 48, 2).mean((1, 3))
    is_inside = (halves > 0.99) & (expected > 0.3)
    ratio = measured.direct[is_inside] / expected[is_inside][:, None]
    assert is_inside.sum() > 60
    assert np.median(ratio) == pytest.approx(1, abs=0.03)  # of the palm, little lies in the fingers' shade
    assert measured.direct[measured.alpha == 0].max() == 0
