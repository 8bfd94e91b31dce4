"""Flow between shifted pictures, and samples of images at points."""

import numpy as np
import pytest
from livehand.backend.person.lit_model.flow import bilinear, flow_between, flow_reliability, nearest

pytest.importorskip("cv2")


def test_a_shift_is_found_to_a_fraction_of_a_pixel():
    from scipy.ndimage import gaussian_filter, shift

    picture = gaussian_filter(np.random.default_rng(1).random((96, 128)), 2)
    picture = (picture - picture.min()) / np.ptp(picture)
    flow = flow_between(picture, shift(picture, (2.0, -3.0), mode="nearest"))
    inner = flow.px[20:-20, 20:-20]
    np.testing.assert_allclose(np.median(inner, (0, 1)), (-3, 2), atol=0.1)
    assert np.median(flow.error_px[20:-20, 20:-20]) < 0.2


def test_a_linear_image_is_sampled_exactly():
    rows, columns = np.mgrid[:10, :12]
    image = 2.0 * columns + 5.0 * rows
    points = np.array([[3.25, 4.5], [7.5, 1.5]])
    np.testing.assert_allclose(bilinear(image, points), 2 * (points[:, 0] - 0.5) + 5 * (points[:, 1] - 0.5))


def test_outside_an_image_there_is_nothing():
    image = np.ones((4, 4, 2))
    assert (bilinear(image, np.array([[-1.0, 2], [2, 9]])) == 0).all()


def test_the_nearest_pixel_is_that_in_which_a_point_lies():
    image = np.arange(12).reshape(3, 4)
    assert nearest(image, np.array([[2.9, 1.1], [99, 99]])).tolist() == [6, 11]


def test_a_straight_edge_tells_of_a_flow_across_it_alone():
    rows, columns = np.mgrid[:80, :80] + 0.5
    reliability = flow_reliability((columns + rows > 80).astype(float), np.array([[40.0, 40.0]]))[0]
    across, along = np.array([1, 1]) / 2**0.5, np.array([1, -1]) / 2**0.5
    np.testing.assert_allclose(reliability @ across, across, atol=1e-3)
    assert np.linalg.norm(reliability @ along) < 0.05


def test_spots_and_blank_places_tell_of_a_flow_what_it_is():
    from scipy.ndimage import gaussian_filter

    spots = gaussian_filter(np.random.default_rng(1).random((80, 80)), 2)
    places = np.array([[40.0, 40.0], [30, 52]])
    for picture in (10 * (spots - spots.mean()), np.full((80, 80), 0.5)):
        assert (np.linalg.eigvalsh(flow_reliability(picture, places)) > 0.7).all()
