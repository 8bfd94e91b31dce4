"""The window on the hand: what it holds, and that cutting and pasting undo one another."""

import numpy as np
import pytest
from livehand.backend.field.rays import camera_tensors
from livehand.backend.geometry.rasterise import NEAR_M
from livehand.backend.image.crop import BUCKET_PX, MARGIN_PX, Crop, hand_crop
from livehand.backend.records.camera import Camera


def window_of(positions, size_px=(200, 160), depth=1.0, reach=0.0):
    positions = np.array(positions, float)
    return hand_crop(positions, np.full(len(positions), depth), np.full(len(positions), reach), size_px)


def test_it_holds_the_hand_and_a_margin_in_low_resolution_pixels():
    window = window_of([[60.0, 80.0], [101.0, 85.5]])
    assert (window.x0, window.y0) == (30 - MARGIN_PX, 40 - MARGIN_PX)
    assert window.width % BUCKET_PX == window.height % BUCKET_PX == 0
    assert 0 <= window.x0 + window.width - (51 + MARGIN_PX) < BUCKET_PX
    assert 0 <= window.y0 + window.height - (43 + MARGIN_PX) < BUCKET_PX


def test_the_shell_reaches_further():
    assert window_of([[60.0, 80.0]], reach=10.0).x0 == 25 - MARGIN_PX


def test_it_does_not_follow_the_hand_far_out_of_the_image():
    window = window_of([[-500.0, -300.0], [900.0, 700.0]])
    assert (window.x0, window.y0) == (-MARGIN_PX, -MARGIN_PX)
    assert window.width >= 100 + 2 * MARGIN_PX
    assert window.width < 100 + 2 * MARGIN_PX + BUCKET_PX
    assert window.height < 80 + 2 * MARGIN_PX + BUCKET_PX


@pytest.mark.parametrize(
    "positions", [[[-50.0, 40.0], [-20.0, 60.0]], [[300.0, 40.0]], [[40.0, -9.0]], [[40.0, 161.0]]]
)
def test_a_hand_out_of_view_has_no_window(positions):
    assert window_of(positions) is None


def test_what_lies_behind_the_camera_does_not_count():
    assert window_of([[60.0, 80.0]], depth=-1.0) is None
    assert window_of([[60.0, 80.0]], depth=NEAR_M / 2) is None
    depth = np.array([1.0, 1.0, -1.0])
    positions = np.array([[60.0, 80.0], [70.0, 90.0], [0.0, 0.0]])
    assert hand_crop(positions, depth, np.zeros(3), (200, 160)) == window_of(positions[:2])


@pytest.mark.parametrize("size_px", [(20, 30), (33, 47)])
@pytest.mark.parametrize("window", [Crop(2, 3, 4, 5), Crop(-3, -2, 16, 32), Crop(6, 9, 16, 16)])
def test_pasting_what_was_cut_gives_the_image_back_inside_the_window(size_px, window):
    image = np.random.default_rng(0).normal(size=(size_px[1], size_px[0], 3))
    cut = window.cut(image, outside=7.0)
    assert cut.shape == (2 * window.height, 2 * window.width, 3)
    target = np.zeros_like(image)
    window.paste(cut, target)
    rows = slice(max(0, 2 * window.y0), 2 * (window.y0 + window.height))
    columns = slice(max(0, 2 * window.x0), 2 * (window.x0 + window.width))
    np.testing.assert_array_equal(target[rows, columns], image[rows, columns])
    assert (target != 0).sum() == image[rows, columns].size
    assert (cut == 7.0).sum() == cut.size - image[rows, columns].size


@pytest.mark.parametrize("scale", [1, 2])
def test_without_superresolution_a_window_counts_pixels_of_the_image(scale):
    image = np.random.default_rng(0).normal(size=(47, 33, 3))
    window = Crop(-3, 5, 16, 32, scale)
    assert window.cut(image).shape == (32 * scale, 16 * scale, 3)
    target = np.zeros_like(image)
    window.paste(window.cut(image), target)
    inside = slice(5 * scale, 37 * scale), slice(0, 13 * scale)
    np.testing.assert_array_equal(target[inside], image[inside])
    assert (target != 0).sum() == image[inside].size
    camera = Camera(np.diag([100.0, 100.0, 1.0]), np.eye(4), (66, 42))
    np.testing.assert_allclose(window.camera_of(camera).K[0, 0], 100 / scale)


def test_a_window_beside_the_image_touches_nothing():
    image = np.ones((10, 10))
    for window in (Crop(20, 0, 4, 4), Crop(-20, 0, 4, 4), Crop(0, 30, 4, 4)):
        window.paste(np.zeros((8, 8)), image)
        assert (window.cut(image, outside=3.0) == 3).all()
    assert (image == 1).all()


def test_its_camera_sees_the_windows_part_of_the_view():
    K = np.array([[100.0, 0, 33], [0, 100, 21], [0, 0, 1]])
    camera = Camera(K, np.eye(4), (66, 42))
    low = Crop(-3, 4, 16, 32).camera_of(camera)
    assert low.size_px == (16, 32)
    # The corner shared by full pixels (2i..2i+1) is the low pixel's centre.
    np.testing.assert_allclose(
        low.ray_directions(np.array([5.5, 7.5])),
        camera.ray_directions(np.array([2 * (5 - 3) + 1.0, 2 * (7 + 4) + 1.0])),
    )


@pytest.mark.parametrize("scale", [1, 2])
def test_tensors_of_its_camera_are_those_of_the_checked_one(scale):
    angle = np.deg2rad(30)
    cam2world = np.eye(4)
    cam2world[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    cam2world[:3, 3] = 0.1, -0.2, 0.3
    camera = Camera(np.array([[300.0, 2, 101], [0, 280, 77], [0, 0, 1]]), cam2world, (200, 160))
    crop = Crop(7, -3, 48, 32, scale)
    ours, checked = (
        crop.tensors_of(camera, camera_tensors(camera, "cpu")),
        camera_tensors(crop.camera_of(camera), "cpu"),
    )
    np.testing.assert_allclose(ours.K, checked.K, rtol=1e-6)
    assert ours.world2cam.equal(checked.world2cam)
    assert ours[2:] == checked[2:]
