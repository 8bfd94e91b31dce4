"""How much of a ray's opacity lies before a depth."""

import numpy as np
import pytest
from livehand.backend.records.depth_profile import DepthProfile, opacity_before


def test_opacity_is_spread_over_its_step():
    t, dt, weights = np.array([[1.0, 1.2]]), np.array([0.2]), np.array([[0.5, 0.25]])
    depth = np.array([[0.5, 0.9, 1.0, 1.05, 1.1, 1.2, 1.3, 9.0]])
    np.testing.assert_allclose(
        opacity_before(depth, t, dt, weights), [[0, 0, 0.25, 0.375, 0.5, 0.625, 0.75, 0.75]], atol=1e-12
    )


def test_transmittance_of_rays_that_meet_the_hand_and_of_others():
    profile = DepthProfile(
        np.array([[0, -1, 1]], np.int32),
        np.array([[1.0], [2.0]]),
        np.array([0.1, 0.1]),
        np.array([[0.8], [1.0]]),
    )
    np.testing.assert_allclose(
        profile.transmittance(np.array([1, -1, 0]), np.array([[1.0, 3.0]] * 3)), [[1, 0], [1, 1], [0.6, 0.2]]
    )
    np.testing.assert_array_equal(profile.alpha, [0.8, 1.0])


@pytest.mark.parametrize("shape", [(4, 6), (3, 5)])
def test_a_depth_map_becomes_opaque_rays(shape):
    depth = np.full(shape, 1e10, np.float32)
    depth[0, 1], depth[2, 2], depth[2, 3] = 0.5, 0.7, 0.6
    profile = DepthProfile.of_depth(depth, 1e10)
    assert profile.row.tolist() == [[0, -1, -1], [-1, 1, -1]]
    np.testing.assert_allclose(profile.t, [[0.5], [0.6]])
    assert (profile.alpha == 1).all()
