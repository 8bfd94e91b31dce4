"""Texture continued over the surface: what is seen stays, what is copied has its variance, kind and direction."""

import numpy as np
import pytest
from livehand.backend.surface.skin_patches import RestPoints, patched

STEP_MM = 1.0


def plane(length_mm=120, breadth_mm=60):
    """Points of a sheet with a back (z up) and, beneath it, a palm."""
    x, y = np.meshgrid(np.arange(0, length_mm, STEP_MM), np.arange(0, breadth_mm, STEP_MM))
    back = np.stack([x.ravel(), y.ravel(), np.full(x.size, 10.0)], 1)
    points = np.concatenate([back, back * [1, 1, -1]])
    return RestPoints(points, np.sign(points[:, 2:]) * [[0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def points():
    return plane()


def waves(points, axis, wavelength_mm):
    return np.sqrt(2) * np.sin(2 * np.pi * points.position_mm[:, axis, None] / wavelength_mm)


def test_what_is_known_stays_and_what_is_not_has_its_variance(points):
    noise = np.random.default_rng(1).normal(size=(len(points.normal), 3))
    is_seen = points.position_mm[:, 0] < 70
    whole = patched(points, noise, is_seen)
    np.testing.assert_allclose(whole[is_seen], noise[is_seen], rtol=1e-6)
    # 6,000 independent texels, each copied about once: a deviation of 1 is seen to 1 / sqrt(12,000) = .01; copies
    # that fall on one texel and the few whole sources make it .05.
    assert whole[~is_seen].std(0) == pytest.approx(1, abs=0.15)
    assert np.abs(whole[~is_seen].mean(0)).max() < 0.15


def test_patches_keep_the_direction(points):
    across = waves(points, 1, 6.0)
    whole = patched(points, across, points.position_mm[:, 0] < 70)[:, 0]
    image = whole[: len(whole) // 2].reshape(60, 120)[:, 80:]
    assert np.abs(np.diff(image, axis=0)).mean() > 2 * np.abs(np.diff(image, axis=1)).mean()


def test_a_palm_is_copied_from_a_palm(points):
    is_palm = points.position_mm[:, 2] < 0
    values = np.where(is_palm[:, None], 1.0, -1.0)
    is_seen = points.position_mm[:, 0] < 70
    whole = patched(points, values, is_seen)[:, 0]
    assert (np.sign(whole) == np.where(is_palm, 1, -1)).mean() > 0.95


def test_nothing_known_gives_nothing(points):
    values = np.ones((len(points.normal), 3))
    assert not patched(points, values, np.zeros(len(values), bool)).any()


def test_all_known_is_left_alone(points):
    values = np.random.default_rng(2).normal(size=(len(points.normal), 1))
    np.testing.assert_allclose(patched(points, values, np.ones(len(values), bool)), values, rtol=1e-6)
