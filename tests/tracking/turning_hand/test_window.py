"""The window around a hand, and its camera, which sees each point where the film's camera sees it."""

import numpy as np
import pytest
from livehand.backend.motion.spaces import to_blender
from livehand.backend.records.camera import Camera
from livehand.backend.tracking.turning_hand.window import (
    LONGEST_PX,
    camera_of,
    image_of,
    window_around,
    with_points,
)

POINTS_PX = np.array([[700.5, 200.0], [1100.0, 950.25], [900.0, 500.0]])
CAMERA = Camera(np.array([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]), to_blender("opencv"), (1920, 1080))


def test_the_window_holds_the_hand_with_a_margin_inside_the_picture():
    window = window_around(POINTS_PX, CAMERA.size_px)
    margin = 0.12 * 750.25
    assert (window.x, window.y) == (int(700.5 - margin), int(200 - margin))
    assert window.x + window.size_px[0] == int(np.ceil(1100 + margin))
    assert window.y + window.size_px[1] == int(np.ceil(950.25 + margin))
    beyond = window_around(np.array([[-50.0, 1000], [100, 1400]]), CAMERA.size_px)
    assert (beyond.x, beyond.y + beyond.size_px[1]) == (0, 1080)


def test_a_point_is_seen_at_the_same_place():
    """Of a picture whose value is the column (or row), the image has at a projected point the point's column."""
    window = window_around(POINTS_PX, CAMERA.size_px)
    camera = camera_of(CAMERA, window)
    assert max(camera.size_px) == LONGEST_PX
    points = np.array([[0.02, 0.5, -0.03], [-0.05, 0.6, 0.04]])
    (before, depth), (after, same_depth) = CAMERA.project(points), camera.project(points)
    share = np.array(camera.size_px) / window.size_px
    np.testing.assert_allclose(after, (before - [window.x, window.y]) * share, atol=1e-9)
    np.testing.assert_array_equal(depth, same_depth)


def test_the_image_is_where_its_camera_says():
    rows, columns = np.mgrid[:1080, :1920]
    spot = np.exp(-((columns + 0.5 - 850) ** 2 + (rows + 0.5 - 610) ** 2) / (2 * 12**2))
    picture = np.repeat((spot * 255).round().astype(np.uint8)[..., None], 3, -1)
    window = window_around(POINTS_PX, CAMERA.size_px)
    camera, image = camera_of(CAMERA, window), image_of(picture, window)[..., 0].astype(float)
    assert image.shape == camera.size_px[::-1]
    middle = [(image * (np.indices(image.shape)[axis] + 0.5)).sum() / image.sum() for axis in (1, 0)]
    point = np.array([(850 - 960) / 1500, 1.0, -(610 - 540) / 1500])  # on that spot's ray
    np.testing.assert_allclose(middle, camera.project(point)[0], atol=0.05)


def test_a_small_window_keeps_its_pixels():
    picture = np.random.default_rng(0).integers(0, 255, (100, 120, 3)).astype(np.uint8)
    window = window_around(np.array([[40.0, 30], [70, 80]]), (120, 100))
    np.testing.assert_array_equal(
        image_of(picture, window), picture[24 : 24 + window.size_px[1], 34 : 34 + window.size_px[0]]
    )


def test_more_points_enlarge_a_window_beyond_the_picture_and_keep_its_scale():
    window = window_around(POINTS_PX, CAMERA.size_px)
    x, y, (width, height) = window[:3]
    larger = with_points(window, np.array([[900.0, 1300.5], [x + 5, y + 5]]))
    assert larger == (x, y, (width, 1301 - y), window.share)
    assert with_points(window, np.array([[x + 5.0, y + 5]])) == window
    far = with_points(window, np.array([[-9e9, 9e9]]))
    assert (far.x, far.y + far.size_px[1]) == (x - height, y + 2 * height)  # at most once its longer side
    point = np.array([0.02, 0.5, -0.03])
    at, at_larger = (camera_of(CAMERA, each).project(point)[0] for each in (window, larger))
    np.testing.assert_allclose(at_larger, at, atol=1)


def test_beyond_the_picture_its_edge_goes_on():
    picture = np.arange(80, dtype=np.uint8).reshape(8, 10, 1).repeat(3, 2)
    window = with_points(window_around(np.array([[0.0, 0], [10, 8]]), (10, 8)), np.array([[-2.0, 9.5]]))
    assert window == (-2, 0, (12, 10), 1)
    seen = image_of(picture, window)[..., 0]
    assert seen[0].tolist() == [0, 0, *range(10)]
    assert seen[:, 2].tolist() == [*range(0, 80, 10), 70, 70]


@pytest.mark.parametrize("points", [[[500.0, 500], [501, 501]], [[-9.0, -9], [-8, -8]]])
def test_a_window_is_never_empty(points):
    assert min(window_around(np.array(points), (120, 100)).size_px) >= 8
