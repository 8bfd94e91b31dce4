"""The camera record: projection and its inverse, crops and scales, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from scipy.spatial.transform import Rotation

K = np.array([[310.0, 0, 41.3], [0, 290.0, 70.9], [0, 0, 1]])


def camera_of(seed=0, size_px=(80, 120)):
    rng = np.random.default_rng(seed)
    cam2world = np.eye(4)
    cam2world[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    cam2world[:3, 3] = rng.normal(size=3)
    return Camera(K, cam2world, size_px)


def test_projection_by_hand():
    camera = Camera(K, np.eye(4), (80, 120))
    pixel, depth = camera.project(np.array([0.2, -0.1, 2.0]))
    np.testing.assert_allclose(pixel, [310 * 0.1 + 41.3, 290 * -0.05 + 70.9])
    assert depth == 2.0
    assert camera.project(np.array([0.0, 0, -1]))[1] == -1


def test_an_orthographic_camera_projects_along_its_axis():
    camera = Camera(K, np.eye(4), (80, 120), is_orthographic=True)
    pixel, depth = camera.project(np.array([[0.2, -0.1, 2.0], [0.2, -0.1, -7.0]]))
    np.testing.assert_allclose(pixel, [[310 * 0.2 + 41.3, 290 * -0.1 + 70.9]] * 2)
    np.testing.assert_array_equal(depth, [2, -7])


def test_an_orthographic_cameras_rays_are_parallel_and_go_through_what_they_are_projected_from():
    camera = replace(camera_of(), is_orthographic=True)
    for one in (camera, camera.cropped(-7, 30, (33, 12)), camera.scaled(0.5)):
        pixels = np.random.default_rng(1).uniform(-20, 150, (4, 5, 2))
        depth = np.random.default_rng(2).uniform(-3, 3, (4, 5))
        points = one.ray_origins(pixels) + depth[..., None] * one.ray_directions(pixels)
        back, back_depth = one.project(points)
        np.testing.assert_allclose(back, pixels, atol=1e-9)
        np.testing.assert_allclose(back_depth, depth, atol=1e-12)
        assert (one.ray_directions(pixels) == camera.cam2world[:3, 2]).all()


def test_an_orthographic_camera_has_no_lens():
    with pytest.raises(LiveHandError, match="turn its depth of field off"):
        replace(camera_of(), is_orthographic=True).through_lens(np.array([0.01, 0.0]), 1.0)


def test_rays_go_through_what_they_are_projected_from():
    camera = camera_of()
    pixels = np.random.default_rng(1).uniform(-20, 150, (4, 5, 2))
    depth = np.random.default_rng(2).uniform(0.1, 3, (4, 5))
    directions = camera.ray_directions(pixels)
    back, back_depth = camera.project(camera.ray_origins(pixels) + depth[..., None] * directions)
    np.testing.assert_allclose(back, pixels, atol=1e-9)
    np.testing.assert_allclose(back_depth, depth, atol=1e-12)
    np.testing.assert_allclose(directions @ camera.cam2world[:3, 2], 1, atol=1e-12)  # scaled to depth 1


def test_a_crop_shifts_pixels_and_keeps_rays():
    camera = camera_of()
    crop = camera.cropped(-7, 30, (33, 12))
    assert crop.size_px == (33, 12)
    pixels = np.random.default_rng(3).uniform(0, 30, (9, 2))
    np.testing.assert_allclose(
        crop.ray_directions(pixels), camera.ray_directions(pixels + np.array([-7, 30])), atol=1e-12
    )


def test_a_low_resolution_centre_is_the_common_corner_of_its_four_pixels():
    camera = camera_of()
    low = camera.scaled(0.5)
    columns, rows = np.meshgrid(np.arange(5), np.arange(4))
    low_centres = np.stack([columns, rows], -1) + 0.5
    corners = np.stack([2 * columns + 1, 2 * rows + 1], -1)  # between pixels 2i and 2i + 1
    np.testing.assert_allclose(low.ray_directions(low_centres), camera.ray_directions(corners), atol=1e-12)


def test_cropping_by_even_pixels_and_halving_commute():
    camera = camera_of()
    one, other = camera.cropped(6, -4, (40, 20)).scaled(0.5), camera.scaled(0.5).cropped(3, -2, (20, 10))
    np.testing.assert_allclose(one.K, other.K, atol=1e-12)
    assert one.size_px == other.size_px


def test_sizes_are_rounded_up():
    assert camera_of(size_px=(33, 47)).scaled(0.5).size_px == (17, 24)
    assert camera_of(size_px=(1, 1)).scaled(0.25).size_px == (1, 1)


def test_look_at_puts_the_target_in_the_middle_and_up_above():
    origin, target, up = np.array([1.0, 2, 3]), np.array([-0.5, 0.4, 0]), np.array([0, 0, 1.0])
    camera = Camera(K, look_at(origin, target, up), (80, 120))
    pixel, depth = camera.project(target)
    np.testing.assert_allclose(pixel, K[:2, 2], atol=1e-12)
    assert depth == pytest.approx(np.linalg.norm(target - origin))
    above, _ = camera.project(target + 0.1 * up)
    assert above[1] < pixel[1] - 1
    assert above[0] == pytest.approx(pixel[0])
    right, _ = camera.project(target + 0.1 * np.cross(target - origin, up))
    assert right[0] > pixel[0] + 1


def bent(**changes):
    cam2world = np.eye(4)
    for (row, column), value in changes.get("entries", {}).items():
        cam2world[row, column] = value
    return cam2world


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((np.eye(4), np.eye(4), (8, 8)), r"K must be \[3, 3\]"),
        ((K, np.eye(3), (8, 8)), r"cam2world must be \[4, 4\]"),
        ((K * np.nan, np.eye(4), (8, 8)), "finite"),
        ((K, bent(entries={(0, 3): np.inf}), (8, 8)), "finite"),
        ((K, bent(entries={(0, 0): 1.01}), (8, 8)), "rotation"),
        ((K, bent(entries={(0, 1): 0.01}), (8, 8)), "rotation"),
        ((K, bent(entries={(0, 0): -1.0}), (8, 8)), "mirrored"),
        ((K, np.eye(4), (8, 0)), "size_px"),
    ],
)
def test_what_is_no_camera_is_refused(values, message):
    with pytest.raises(LiveHandError, match=message):
        Camera(*values)


def test_a_point_of_the_lens_keeps_the_plane_of_focus_where_it_is():
    cam2world = np.eye(4)
    cam2world[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    cam2world[:3, 3] = [1.0, 2, 3]
    camera = Camera(np.array([[500.0, 0, 50], [0, 400, 40], [0, 0, 1]]), cam2world, (100, 80))
    beside = camera.through_lens(np.array([0.01, -0.02]), 2.0)
    np.testing.assert_allclose(beside.origin - camera.origin, cam2world[:3, :3] @ [0.01, -0.02, 0])
    in_focus, behind = (camera.origin + depth * camera.ray_directions(np.array([20.0, 70.0])) for depth in (2.0, 4.0))
    np.testing.assert_allclose(beside.project(in_focus)[0], [20, 70])
    # A point twice as far moves by f * offset * (1 / focus - 1 / depth).
    np.testing.assert_allclose(beside.project(behind)[0] - [20, 70], [500 * 0.01 / 4, -400 * 0.02 / 4])
