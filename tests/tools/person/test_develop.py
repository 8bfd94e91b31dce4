"""The phone's film: gains, the wall and the sensor."""

import numpy as np
import pytest
from livehand.backend.records.camera import Camera, look_at
from livehand.tools.person.develop import WANDER, WHITE, behind, brightness, developed, film_gains, made_wall


def test_gains_of_steady_light_expose_it_and_wander_within_bounds():
    gains = film_gains(np.full(72, 0.4), 6.0, 7)
    assert gains.shape == (72, 3)
    logs = np.log(gains * 0.4 / WHITE)
    assert abs(logs).max() <= 1.75 * np.log1p(WANDER)
    warmth = (logs[:, 0] - logs[:, 2]) / 2  # what exposure and tint share does not count
    assert abs(warmth).max() == pytest.approx(np.log1p(WANDER), rel=0.1)


def test_exposure_follows_late():
    bright = np.where(np.arange(40) < 20, 0.2, 0.8)
    followed = film_gains(np.full(40, 0.2), 6.0, 7) / film_gains(bright, 6.0, 7)
    np.testing.assert_allclose(followed[:20], 1)
    assert 1 < followed[20, 1] < 3
    assert followed[-1, 1] == pytest.approx(4, rel=0.02)


def test_brightness_is_that_of_the_hand_alone():
    picture = np.zeros((20, 20, 4), np.float32)
    picture[:10] = 0.3, 0.5, 0.2, 1
    picture[10:, :, :3] = 9
    assert brightness(picture) == pytest.approx(0.5)


def test_the_sensor_encodes_clips_and_makes_the_noise_of_its_law():
    rng = np.random.default_rng(0)
    picture = np.zeros((100, 100, 4), np.float32)
    ground = np.full((100, 100, 3), 0.2)
    shown = developed(picture, ground, np.ones(3), rng) / 255
    assert shown.mean() == pytest.approx(0.4845, abs=1e-3)  # sRGB's code of 0.2
    slope = 1.055 / 2.4 * 0.2 ** (1 / 2.4 - 1)
    assert shown.std() == pytest.approx(slope * np.sqrt(0.002**2 + 0.0005 * 0.2), rel=0.05)
    picture[:] = 4, 4, 4, 1
    assert (developed(picture, ground, np.ones(3), rng) == 255).all()


def test_the_wall_is_a_plane_that_stays_where_it_is():
    wall = np.zeros((800, 800, 3))
    wall[400:, 400:] = 1  # below the middle, on the right
    K = np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]])
    ahead = Camera(K, look_at(np.array([0, -0.45, 0]), np.array([0, 0, 0.0]), np.array([0, 0, 1.0])), (64, 48))
    seen = behind(ahead, wall)[..., 0]
    assert seen[:23].max() == 0
    assert seen[:, :31].max() == 0
    assert seen[26:, 34:].min() == pytest.approx(1)
    aside = Camera(K, ahead.cam2world + np.array([[0, 0, 0, 0.205], *[[0, 0, 0, 0]] * 3]), (64, 48))
    moved = behind(aside, wall)[..., 0]
    np.testing.assert_allclose(moved[:, :50], seen[:, 10:60], atol=0.05)  # 0.205 m at 2.05 m: 10 px


def test_walls_are_positive_and_differ_by_seed():
    one, other = (made_wall(np.random.default_rng(seed)) for seed in (1, 2))
    assert one.min() > 0
    assert one.max() < 1
    assert abs(one - other).mean() > 0.01
