"""A camera whose picture holds what it is to show."""

import numpy as np
import pytest
from livehand.backend.geometry.framing import fitting_camera

POINTS = np.random.default_rng(3).uniform([-0.1, 0.3, 1.0], [0.05, 0.34, 1.2], (200, 3))


@pytest.mark.parametrize("size_px", [(300, 400), (400, 100), (64, 64)])
@pytest.mark.parametrize("towards", [(0.0, -1.0, 0.0), (-1.0, 0.4, 0.3)])
def test_the_points_fill_their_share_in_the_middle(size_px, towards):
    camera = fitting_camera(POINTS, towards, size_px, 0.9)
    seen, depth = camera.project(POINTS)
    assert (depth > 0.5).all()
    extent = np.ptp(seen, axis=0) / size_px
    assert extent.max() == pytest.approx(0.9)
    np.testing.assert_allclose((seen.min(0) + seen.max(0)) / 2, np.array(size_px) / 2)


def test_the_camera_stands_where_it_is_asked_to_upright():
    camera = fitting_camera(POINTS, (0.0, -1.0, 0.0), (64, 64), 0.9)
    middle = (POINTS.min(0) + POINTS.max(0)) / 2
    offset = camera.origin - middle
    np.testing.assert_allclose(offset / np.linalg.norm(offset), [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(camera.cam2world[:3, 1], [0, 0, -1], atol=1e-12)  # down in the picture is -Z
