"""Which pieces triangles hide from a hand, against rays."""

import numpy as np
from livehand.backend.light.nearby_geometry import Blockers, Pieces

NEAR = np.array([[0.0, 0, 1], [0.02, 0, 1.05]])
GROUND = np.array([[[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]])


def seen_over(triangles):
    some = Pieces.of(GROUND, np.ones((1, 3)), NEAR, 0.1)
    return some, Blockers.of(triangles, NEAR).seen(some)


def test_a_triangle_hides_its_shadow_seen_from_the_hand():
    """Half as high as the hand's lowest vertex, its shadow is twice as large."""
    board = np.array([[[-0.1, -0.1, 0.5], [0.2, -0.1, 0.5], [-0.1, 0.2, 0.5]]])
    some, seen = seen_over(np.concatenate([GROUND, board]))
    u, v = (some.position[:, 0] + 0.2) / 0.6, (some.position[:, 1] + 0.2) / 0.6
    is_hidden = (u > 0) & (v > 0) & (u + v < 1)
    assert 20 < is_hidden.sum() < 0.5 * len(is_hidden)
    np.testing.assert_array_equal(seen.position, some.position[~is_hidden])


def test_what_lies_behind_or_beyond_or_has_no_area_hides_nothing():
    up = np.array([0, 0, 0.5])
    for triangles in (GROUND - up, GROUND + 3 * up, (GROUND + up)[:, [0, 0, 1]], GROUND):
        some, seen = seen_over(triangles)
        assert len(seen.area) == len(some.area) > 100
