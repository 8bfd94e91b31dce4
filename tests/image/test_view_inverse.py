"""The inverse of view transforms that have closed forms, and the interpolation of its table."""

import numpy as np
import pytest
from livehand.backend.image.view_inverse import GRID_SIZE, ViewInverse, interpolated


def standard(rgb):
    return np.clip(rgb, 0, 1) ** (1 / 2.2)


def filmic(rgb):
    """A curve that compresses light without bounds into [0, 1), and desaturates."""
    light = np.maximum(rgb, 0)
    mixed = 0.8 * light + 0.2 * light.mean(-1, keepdims=True)
    return (mixed / (1 + mixed)) ** (1 / 2.2)


@pytest.mark.slow
def test_inverted_colours_are_shown_as_standard_shows_them():
    inverse = ViewInverse.solve(filmic, standard)
    greys = np.linspace(0.02, 0.8, 9)[:, None] * np.array([1.0, 0.9, 0.8])
    assert np.abs(filmic(inverse(greys)) - standard(greys)).max() < 1 / 255
    assert np.abs(filmic(greys) - standard(greys)).max() > 20 / 255


def test_a_view_that_shows_all_colours_alike_has_a_large_error():
    assert ViewInverse.solve(lambda rgb: np.full_like(rgb, 0.5), standard).error > 0.1


def test_type_and_shape_are_kept():
    inverse = ViewInverse(np.zeros((GRID_SIZE, GRID_SIZE, GRID_SIZE, 3)), 0.0)
    assert inverse(np.zeros((4, 5, 3), np.float32)).shape == (4, 5, 3)
    assert inverse(np.zeros((4, 5, 3), np.float32)).dtype == np.float32


@pytest.mark.parametrize("size", [2, GRID_SIZE])
def test_interpolation_is_exact_for_functions_linear_in_each_axis(size):
    ticks = np.linspace(0, 1, size)
    r, g, b = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    axis = np.random.default_rng(1).uniform(0, 1, (100, 3))
    axis[:4] = [[0, 0, 0], [1, 1, 1], [1, 0, 0.5], [0.25, 1, 0]]
    got = interpolated(np.stack([r, 2 * g - r, r * g * b], -1), axis)
    expected = np.stack([axis[:, 0], 2 * axis[:, 1] - axis[:, 0], axis.prod(-1)], -1)
    np.testing.assert_allclose(got, expected, atol=1e-12)
