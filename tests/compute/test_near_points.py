"""The nearest of some points: as scipy's tree finds them."""

import numpy as np
import pytest
from livehand.backend.compute.kernels.near_points import find_near_points
from scipy.spatial import KDTree


@pytest.mark.parametrize("count", [1, 7, 8, 75])
def test_the_nearest_is_found_within_reach_and_beside_the_box(count):
    points = np.random.default_rng(count).uniform(0, 1, (300, 3))
    sought, seekers = np.arange(count), np.arange(100, 300)
    points[sought] *= 0.6
    found = np.empty(len(seekers), np.int64)
    find_near_points(points, seekers, sought, 0.05, 0.15, found)
    distance, which = KDTree(points[sought]).query(points[seekers])
    low, high = points[sought].min(0) - 0.05, points[sought].max(0) + 0.05
    is_beside = ((points[seekers] > low) & (points[seekers] < high)).all(1)
    np.testing.assert_array_equal(found, np.where(is_beside & (distance < 0.15), which, -1))
    assert (found < 0).any()
    assert (count == 1) or (found >= 0).any()
