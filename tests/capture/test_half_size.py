"""Captures at half their size: cameras and images agree, whatever the file's kind."""

import numpy as np
import pytest
from livehand.backend.capture.half_size import half_size


def test_images_are_means_and_cameras_follow(painted_capture):
    half = half_size(painted_capture)
    view, whole = half.views[0], painted_capture.views[0]
    assert view.camera.size_px == (12, 16)
    point = np.array([0.01, -0.02, 0.03])
    assert view.camera.project(point)[0] == pytest.approx(whole.camera.project(point)[0] / 2)
    expected = painted_capture.read_image(whole).reshape(16, 2, 12, 2, 4).mean((1, 3))
    assert half.read_image(view) == pytest.approx(expected)
    pixels = half.read_pixels(view).astype(float) / 255
    assert pixels[..., 3] == pytest.approx(expected[..., 3], abs=0.003)
    assert pixels[..., :3] * pixels[..., 3:] == pytest.approx(expected[..., :3], abs=0.005)
    linear = painted_capture.read_linear(whole).reshape(16, 2, 12, 2, 4).mean((1, 3))
    assert half.read_linear(view) == pytest.approx(linear, abs=1e-6)


def test_it_is_another_capture_for_checkpoints(painted_capture):
    half = half_size(painted_capture)
    assert half.provenance != painted_capture.provenance
    assert half.of_split("train")[0].file == painted_capture.of_split("train")[0].file
