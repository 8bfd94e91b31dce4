"""What is drawn on strangers, against closed forms."""

import numpy as np
import pytest
from livehand.backend.capture.person import PERSONS
from livehand.tools.person.strangers import LOG_LIMITS, STRANGERS, Stroke, ink, log_factor, smooth_noise, spots

UP, DOWN = np.array([0.0, 1, 0]), np.array([0.0, -1, 0])
OUTSIDE = ("stranger1", "stranger2", "stranger3")
LINE = Stroke(np.array([[0.0, 0], [10, 0]]), 2.0, (-1.0, -1.0, -1.0))


@pytest.mark.parametrize(
    ("x", "z", "share"), [(5, 0, 1), (5, 0.6, 1), (5, 1.0, 0.5), (5, 1.4, 0), (-1, 0, 0.5), (11.5, 0, 0), (12, 0, 0)]
)
def test_ink_ends_at_half_the_width_of_a_line(x, z, share):
    assert ink(LINE, np.array([[x, 7.0, z]]), UP[None]) == pytest.approx([share])


def test_ink_stays_on_its_side():
    points = np.array([[5.0, 7, 0], [5, -7, 0]])
    in_palm = Stroke(LINE.points_mm, LINE.width_mm, LINE.log_rgb, is_dorsal=False)
    assert ink(LINE, points, np.stack([UP, DOWN])).tolist() == [1, 0]
    assert ink(in_palm, points, np.stack([UP, DOWN])).tolist() == [0, 1]


def test_noise_forgets_as_a_gaussian_of_its_size():
    rng = np.random.default_rng(0)
    at = rng.uniform(-30, 30, (2000, 3))
    pairs = [at + np.array(moved) for moved in ((0, 0, 0), (3, 0, 0), (0, 6, 0), (0, 0, 20))]
    products = np.zeros(len(pairs))
    for seed in range(40):
        values = [smooth_noise(np.random.default_rng(seed), points, 3.0) for points in pairs]
        products += [np.mean(values[0] * other) / 40 for other in values]
    assert products == pytest.approx([1, np.exp(-0.5), np.exp(-2), 0], abs=0.06)


def test_a_spot_is_a_gaussian_around_one_of_the_points():
    at = np.stack([np.linspace(-30, 30, 6001), np.zeros(6001), np.zeros(6001)], 1)
    drawn = spots(np.random.default_rng(3), at, 1)
    centre = drawn[:, 1].argmin()
    depth = -drawn[centre, 1]
    assert 0.3 <= depth <= 1.1
    inner = np.abs(np.arange(6001) - centre) < 50
    logs, squared = np.log(-drawn[inner, 1] / depth), (at[inner, 0] - at[centre, 0]) ** 2
    sigma = np.sqrt(-squared.max() / 2 / logs[squared.argmax()])
    assert 0.7 <= sigma <= 2.0
    assert logs == pytest.approx(-squared / (2 * sigma**2), abs=1e-9)
    assert drawn[np.abs(at[:, 0] - at[centre, 0]) > 8.01].max() == drawn.max() == 0
    assert drawn[centre, 0] > drawn[centre, 1] > drawn[centre, 2]


def test_the_factor_is_drawn_from_its_seed_within_limits():
    at = np.random.default_rng(0).uniform(-60, 60, (500, 3))
    normals = np.tile(UP, (500, 1))
    assert not log_factor(STRANGERS["insider"], at, normals).any()
    for stranger in (STRANGERS[name] for name in OUTSIDE):
        factor = log_factor(stranger, at, normals)
        assert np.array_equal(factor, log_factor(stranger, at, normals))
        assert LOG_LIMITS[0] <= factor.min() < -0.2 < 0.2 < factor.max() <= LOG_LIMITS[1]


def test_strangers_are_none_of_the_people_that_are_known():
    assert sorted(STRANGERS[name].person.melanin for name in OUTSIDE) == [0.15, 0.5, 0.9]
    numbers = [(one.melanin, one.folds, one.veins_mm, one.beta) for one in PERSONS.values()]
    for stranger in STRANGERS.values():
        own = stranger.person
        assert all(own.beta != beta and own.veins_mm != veins for _, _, veins, beta in numbers)
