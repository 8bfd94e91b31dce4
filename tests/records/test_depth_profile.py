"""How much of a ray's opacity lies before a depth."""

import numpy as np
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


def test_a_surface_becomes_one_sample_a_pixel_of_its_coverage():
    depth, alpha = np.full((4, 6), 1e10, np.float32), np.zeros((4, 6), np.float32)
    depth[1:3, 1:3], alpha[1:3, 1:3], alpha[1, 3] = [[0.5, 0.5005], [0.5003, 0.5008]], 1, 0.25
    profile = DepthProfile.of_surface(depth, alpha, 1e10)
    assert profile.row.tolist() == [[-1] * 6, [-1, 0, 1, 2, -1, -1], [-1, 3, 4, -1, -1, -1], [-1] * 6]
    np.testing.assert_array_equal(profile.t[:, 0], np.float32([0.5, 0.5005, 0.5005, 0.5003, 0.5008]))
    np.testing.assert_array_equal(profile.alpha, np.float32([1, 1, 0.25, 1, 1]))


def test_a_surfaces_step_is_what_its_depth_changes_by_within_a_pixel():
    """A plane of 0.3 mm a column and 0.2 mm a row, that ends before another."""
    y, x = np.mgrid[:8, :10].astype(np.float64)
    depth = 1 + 3e-4 * x + 2e-4 * y
    depth[:, 6:] += 0.5
    profile = DepthProfile.of_surface(depth, np.ones_like(depth), 1e10)
    np.testing.assert_allclose(profile.dt, 5e-4, rtol=1e-4)
    level = DepthProfile.of_surface(np.ones((3, 1)), np.ones((3, 1)), 1e10)
    np.testing.assert_allclose(level.dt, 1e-4)
