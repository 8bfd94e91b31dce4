"""Pieces of surfaces: how fine they are, their sides, and what gathering keeps."""

import numpy as np
import pytest
from livehand.backend.light.nearby_geometry import LEAST_M, Pieces, distance_of

FINENESS = 0.5
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])[[[0, 1, 2], [0, 2, 3]]]
ALBEDO = np.array([[0.8, 0.2, 0.1], [0.2, 0.4, 0.6]])
ABOVE = np.array([[0.0, 0, 0.1], [0.05, 0, 0.15]])


def pieces(near, triangles=SQUARE):
    return Pieces.of(triangles, ALBEDO, near, FINENESS)


def areas(some):
    return np.linalg.norm(some.area, axis=-1)


def test_pieces_are_small_against_their_distance_and_cover_the_triangles():
    some = pieces(ABOVE)
    sides = np.linalg.norm(some.corners - np.roll(some.corners, -1, 1), axis=-1).max(1)
    distance = distance_of(some.position, ABOVE)
    assert (sides <= FINENESS * np.maximum(distance, LEAST_M)).all()
    assert len(np.unique(np.round(sides, 6))) > 3
    assert areas(some).sum() == pytest.approx(4)
    np.testing.assert_allclose((areas(some)[:, None] * some.albedo).sum(0), 2 * ALBEDO.sum(0))


@pytest.mark.parametrize(
    ("near", "up", "down"), [(ABOVE, 4, 0), (-ABOVE, 0, 4), (np.concatenate([ABOVE, -2 * ABOVE]), 4, 4)]
)
def test_a_triangle_has_the_sides_that_have_some_of_the_hand_before_them(near, up, down):
    some = pieces(near)
    normal = some.area[:, 2]
    assert (normal[normal > 0].sum(), -normal[normal < 0].sum()) == pytest.approx((up, down))
    assert (some.is_back == (normal < 0)).all()
    assert ((some.vertex - some.position)[:, 2] * normal > 0).all()


def test_the_nearest_vertex_before_a_piece_is_told():
    """Not one that is nearer and behind its plane."""
    near = np.array([[0, 0, -0.01], [0.3, 0, 0.2], [-0.3, 0, 0.2]])
    some = pieces(near)
    up = some.chosen(some.area[:, 2] > 0)
    np.testing.assert_array_equal(up.vertex, near[np.where(up.position[:, 0] > 0, 1, 2)])
    assert up.distance == pytest.approx(np.linalg.norm(up.vertex - up.position, axis=1))


def test_gathering_keeps_area_and_albedo_and_lifts():
    some = pieces(np.concatenate([ABOVE, -ABOVE]))
    whole, group = some.gathered(some.cells(4 * FINENESS), ABOVE)
    assert 4 < len(whole.area) < 0.2 * len(some.area)
    assert areas(whole).sum() == pytest.approx(8)
    assert group.shape == (len(some.area),)
    assert set(group) == set(range(len(whole.area)))
    np.testing.assert_allclose((areas(whole)[:, None] * whole.albedo).sum(0), 4 * ALBEDO.sum(0))
    np.testing.assert_allclose(whole.position[:, 2], 0.001 * np.sign(whole.area[:, 2]), atol=1e-9)
    assert (whole.is_back == (whole.area[:, 2] < 0)).all()


def test_the_largest_look_so_from_the_hand():
    some = pieces(ABOVE)
    order = some.largest(10)
    offset = some.vertex - some.position
    seen = (offset * some.area).sum(-1) / np.maximum(np.linalg.norm(offset, axis=-1), LEAST_M) ** 3
    np.testing.assert_allclose(seen[order], np.sort(seen)[::-1][:10])
    assert len(some.largest(10**6)) == len(some.area)


def test_no_pieces_are_none():
    none = Pieces.none()
    assert len(none.cells(1.0)) == 0
    assert len(none.largest(4)) == 0
