"""Exposure samples: even over the shutter and the lens, and in focus at the plane of focus."""

import numpy as np
import pytest
from livehand.backend.image.exposure import SHARP, ExposureSample, Lens, Shutter, camera_of_sample, exposure_samples
from livehand.backend.records.camera import Camera


def test_a_sharp_frame_has_one_sample():
    assert exposure_samples(16, None, None) == (SHARP,)


def test_samples_are_spread_evenly_over_the_shutter_the_nearest_first():
    samples = exposure_samples(4, Shutter(-0.25, 0.5), None)
    assert sorted(sample.offset_frames for sample in samples) == pytest.approx([-0.1875, -0.0625, 0.0625, 0.1875])
    assert [abs(sample.offset_frames) for sample in samples] == pytest.approx([0.0625, 0.0625, 0.1875, 0.1875])
    assert {sample.lens for sample in samples} == {(0.0, 0.0)}


def test_points_of_the_lens_fill_it_evenly():
    samples = exposure_samples(64, None, Lens(0.01, 1.0))
    points = np.array([sample.lens for sample in samples])
    assert {sample.offset_frames for sample in samples} == {0.0}
    radius = np.linalg.norm(points, axis=1)
    assert np.sort(radius**2) == pytest.approx((np.arange(64) + 0.5) / 64)
    assert np.abs(points.mean(0)).max() < 0.05
    distance = np.linalg.norm(points[:, None] - points, axis=-1) + 9 * np.eye(64)
    assert distance.min() > 0.02


@pytest.mark.parametrize("count", [8, 16, 24, 32])
def test_any_part_of_the_exposure_sees_the_whole_lens(count):
    samples = sorted(
        exposure_samples(count, Shutter(0.0, 1.0), Lens(0.01, 1.0)), key=lambda sample: sample.offset_frames
    )
    squares = np.array([np.sum(np.square(sample.lens)) for sample in samples])
    assert np.sort(squares) == pytest.approx((np.arange(count) + 0.5) / count)
    quarters = squares.reshape(4, -1)
    assert np.abs(quarters.mean(1) - 0.5).max() < 0.2
    assert quarters.min(1).max() < 0.45
    assert quarters.max(1).min() > 0.55


def test_a_point_in_focus_is_at_the_same_pixel_through_every_point_of_the_lens():
    camera = Camera(np.array([[66.7, 0, 24], [0, 66.7, 32], [0, 0, 1]]), np.eye(4), (48, 64))
    beside = camera_of_sample(camera, Lens(0.02, 0.5), ExposureSample(0.0, (0.6, -0.3)))
    point = camera.origin + 0.5 * camera.ray_directions(np.array([10.0, 20.0]))
    assert beside.project(point)[0] == pytest.approx([10, 20])
    assert np.linalg.norm(beside.origin - camera.origin) == pytest.approx(0.02 * np.hypot(0.6, 0.3))
    assert camera_of_sample(camera, None, SHARP) is camera
