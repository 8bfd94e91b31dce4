"""Spherical harmonics of splats, against their definition."""

import numpy as np
import pytest
from livehand.backend.render.splats.gaussians import MIDDLE, Splats, harmonic_basis, joined
from livehand.backend.render.splats.lit_views import directions
from scipy.special import lpmv


def splats_of(harmonics, positions):
    count = len(positions)
    turns, sizes = np.tile([1.0, 0, 0, 0], (count, 1)), np.full((count, 3), 0.01)
    return Splats(positions, turns, sizes, np.full(count, 0.5), harmonics, positions, np.zeros((count, 3)))


def test_harmonics_are_orthonormal_over_the_sphere():
    basis = harmonic_basis(3 * directions(20_000), 3)
    np.testing.assert_allclose(4 * np.pi * basis.T @ basis / len(basis), np.eye(16), atol=2e-3)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_harmonics_are_legendres_functions_by_order(degree):
    """With the Condon-Shortley phase, which `lpmv` has, too."""
    found, (x, y, z) = harmonic_basis(directions(50), degree), directions(50).T
    angle = np.arctan2(y, x)
    for order in range(-degree, degree + 1):
        number = abs(order)
        ratio = np.prod(np.arange(degree - number + 1, degree + number + 1, dtype=float))
        factor = np.sqrt((2 * degree + 1) / (4 * np.pi) / ratio) * lpmv(number, degree, z)
        turning = 1.0 if order == 0 else np.sqrt(2) * (np.sin if order < 0 else np.cos)(number * angle)
        np.testing.assert_allclose(found[:, degree * degree + degree + order], factor * turning, atol=1e-12)


def test_colors_are_seen_from_the_camera_and_not_negative():
    harmonics = np.zeros((2, 4, 3))
    harmonics[0, 2, 0], harmonics[1, 0] = 1, -10
    colors = splats_of(harmonics, np.zeros((2, 3))).colors(np.array([0, 0, -2.0]))
    np.testing.assert_allclose(colors[0], [MIDDLE + np.sqrt(3 / (4 * np.pi)), MIDDLE, MIDDLE])
    assert (colors[1] == 0).all()


def test_joined_splats_keep_their_order():
    one, other = splats_of(np.zeros((1, 16, 3)), np.ones((1, 3))), splats_of(np.ones((2, 16, 3)), np.zeros((2, 3)))
    both = joined([one, other])
    assert (len(both), both.degree) == (3, 3)
    np.testing.assert_array_equal(both.harmonics[:, 0, 0], [0, 1, 1])
