"""Frames through Blender's buffers to an 8-bit PNG: known sRGB colours come back bit for bit."""

import bpy
import numpy as np
import pytest
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.livehand_blender.scene.colour import in_working_space, rec709_to_working_space
from PIL import Image


def srgb_to_linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def frame_of_levels(srgb_levels, alpha_levels):
    """The frame whose straight colour and alpha are these 8-bit levels."""
    alpha = alpha_levels / 255
    rgb = srgb_to_linear(srgb_levels / 255) * alpha[..., None]
    depth = np.where(alpha > 0, 0.5, DEPTH_BACKGROUND)
    return Frame(rgb.astype(np.float32), alpha.astype(np.float32), depth.astype(np.float32))


def saved_png(frame, path):
    """What Blender saves for this Combined pass: through a float image, whose pixels take the same buffer."""
    height, width = frame.alpha.shape
    image = bpy.data.images.new("frame", width, height, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    image.alpha_mode = "PREMUL"
    rgba = np.concatenate([in_working_space(frame).rgb, frame.alpha[..., None]], -1)
    image.pixels.foreach_set(np.ascontiguousarray(rgba[::-1]).ravel())
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.render.dither_intensity = "Standard", 0
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    image.save_render(str(path), scene=scene)
    return np.array(Image.open(path))


def test_all_opaque_levels_come_back_exactly(tmp_path):
    levels = np.stack(np.meshgrid(np.arange(256), [0, 64, 128, 255]), -1)
    srgb = np.concatenate([levels, levels[..., :1][:, ::-1]], -1)
    png = saved_png(frame_of_levels(srgb, np.full(srgb.shape[:2], 255)), tmp_path / "opaque.png")
    assert np.array_equal(png[..., :3], srgb)
    assert (png[..., 3] == 255).all()


def test_semi_transparent_levels_come_back_exactly(tmp_path):
    srgb = np.random.default_rng(0).integers(0, 256, (64, 64, 3))
    alpha = np.random.default_rng(1).integers(40, 255, (64, 64))
    png = saved_png(frame_of_levels(srgb, alpha), tmp_path / "edge.png")
    assert np.array_equal(png, np.concatenate([srgb, alpha[..., None]], -1))


def test_a_rec709_scene_changes_no_bit():
    assert np.array_equal(rec709_to_working_space(), np.eye(3))


def test_another_working_space_is_applied_to_colour_only(monkeypatch):
    matrix = np.array([[0.6, 0.3, 0.1], [0.1, 0.9, 0.0], [0.0, 0.1, 0.9]])

    class Rec2020Color:
        def __init__(self, rgb):
            self.rgb = rgb

        def from_rec709_linear_to_scene_linear(self):
            return matrix @ self.rgb

    monkeypatch.setattr("mathutils.Color", Rec2020Color)
    frame = frame_of_levels(np.array([[[200, 100, 20]]]), np.full((1, 1), 100))
    converted = in_working_space(frame)
    assert converted.rgb[0, 0] == pytest.approx(matrix @ frame.rgb[0, 0], abs=1e-6)
    assert converted.alpha is frame.alpha
