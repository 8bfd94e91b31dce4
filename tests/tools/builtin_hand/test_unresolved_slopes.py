"""Slopes that bend the fine surface's normals into the detailed surface's: closed forms, and those that ship."""

import numpy as np
import pytest
from livehand.backend.geometry.loop import split_corners
from livehand.backend.surface.detail_maps_file import ATLAS_MM, load_surface_detail
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.tools.builtin_hand.unresolved_slopes import slopes_between, spread_over_atlas, unresolved_slopes
from scipy.ndimage import binary_dilation

SIDE_M = ATLAS_MM / 1000
UV = np.array([[[0.2, 0.1], [0.7, 0.2], [0.3, 0.8]]])
FLAT = np.concatenate([UV * SIDE_M, np.zeros((1, 3, 1))], -1)
UP = np.tile([0.0, 0, 1], (1, 3, 1))


def unit(*vector):
    return np.tile(np.array(vector) / np.linalg.norm(vector), (1, 3, 1))


def test_a_height_s_slopes_are_those_of_its_normal():
    """The height 0.3 u - 0.2 v, whose normal is (-0.3, 0.2, 1), on a triangle as large as in the atlas."""
    np.testing.assert_allclose(slopes_between(UP, unit(-0.3, 0.2, 1), FLAT, UV)[0], [[0.3, -0.2]] * 3, atol=1e-12)
    np.testing.assert_allclose(slopes_between(UP, UP, FLAT, UV), 0, atol=1e-15)


def test_a_triangle_that_is_larger_than_in_the_atlas_has_steeper_slopes_over_it():
    np.testing.assert_allclose(slopes_between(UP, unit(-0.3, 0.2, 1), 2 * FLAT, UV)[0], [[0.6, -0.4]] * 3, atol=1e-12)


def test_what_is_even_stays_even_within_triangles_and_nothing_is_beside():
    corners = UV
    for _ in range(4):
        corners = split_corners(corners)
    found = spread_over_atlas(corners, np.full((len(corners), 3, 2), (0.25, -0.5)), 16)
    assert found.shape == (2, 16, 16)
    inside = found[0] != 0
    np.testing.assert_allclose(found[:, inside], np.tile([[0.25], [-0.5]], inside.sum()), rtol=1e-6)
    assert inside[6, 6]
    assert not inside[:, 15:].any()


@pytest.fixture(scope="module")
def made(hand):
    return unresolved_slopes(hand, detailed_surface(hand, levels=3), 1024)


@pytest.mark.nightly
def test_those_that_ship_are_the_generators(hand, made):
    shipped = load_surface_detail(hand.sha256).unresolved
    assert shipped.shape == made.shape
    assert np.abs(shipped - made.clip(-1.27, 1.27)).max() < 0.0051


@pytest.mark.nightly
def test_nails_and_creases_alone_need_them(hand, made):
    """Half of the skin needs less than a quarter of a degree; half of nails and their rims more than 1.7."""
    steep = np.abs(made).max(0)
    is_nail = load_surface_detail(hand.sha256).nail.repeat(2, 0).repeat(2, 1) > 0.5
    at_nails = binary_dilation(is_nail, iterations=6)
    assert np.median(steep[steep > 0]) < 0.0044
    assert np.median(steep[at_nails]) > 0.03
