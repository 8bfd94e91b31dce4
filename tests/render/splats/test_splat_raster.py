"""The rasteriser of splats against closed forms, and against a slow one that is written from the definition."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, axis_angle_to_quaternion
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.render.splats.gaussians import Splats
from livehand.backend.render.splats.splat_raster import rasterised, splat_weights

WIDENED_PX2 = 0.3


def splats_of(positions, scales, colors, opacity, turns=None):
    count = len(positions)
    turns = np.zeros((count, 3)) if turns is None else turns
    harmonics = (np.asarray(colors, float)[:, None] - 0.5) * np.sqrt(4 * np.pi)
    rotations = axis_angle_to_quaternion(np.asarray(turns, float))
    normals, albedo = np.zeros((count, 3)), np.zeros((count, 3))
    scales, opacity = np.asarray(scales, float), np.asarray(opacity, float)
    return Splats(np.asarray(positions, float), rotations, scales, opacity, harmonics, normals, albedo)


@pytest.fixture
def camera():
    """From the origin along Z."""
    return Camera(np.array([[100.0, 0, 20.5], [0, 100, 15.5], [0, 0, 1]]), np.eye(4), (41, 31))


def test_one_round_splat_is_a_gaussian(camera):
    found = rasterised(splats_of([[0, 0, 2]], [[0.05] * 3], [[1, 0.5, 0]], [0.8]), camera)
    variance = (100 * 0.05 / 2) ** 2 + WIDENED_PX2
    x, y = np.arange(41) + 0.5 - 20.5, np.arange(31)[:, None] + 0.5 - 15.5
    squared = (x * x + y * y) / variance
    alpha = np.where((squared <= 9) & (0.8 * np.exp(-squared / 2) >= 1 / 255), 0.8 * np.exp(-squared / 2), 0)
    np.testing.assert_allclose(found[..., 3], alpha, atol=1e-5)
    np.testing.assert_allclose(found[..., :3], alpha[..., None] * [1, 0.5, 0], atol=1e-5)


@pytest.mark.parametrize("nearer", [0, 1])
def test_the_nearer_of_two_is_before_the_other(camera, nearer):
    depths = [2.0, 2.2] if nearer == 0 else [2.2, 2.0]
    two = splats_of([[0, 0, depths[0]], [0, 0, depths[1]]], [[0.05] * 3] * 2, [[1, 0, 0], [0, 1, 0]], [0.6, 0.5])
    weights = splat_weights(two, camera).shown(np.eye(2))[15 * 41 + 20]
    alpha = np.array([0.6, 0.5])
    expected = alpha * np.where(np.arange(2) == nearer, 1, 1 - alpha[nearer])
    np.testing.assert_allclose(weights, expected, atol=1e-5)


def test_splats_behind_the_camera_and_beside_the_picture_are_not_drawn(camera):
    hidden = splats_of([[0, 0, -2], [5, 0, 2]], [[0.05] * 3] * 2, [[1, 1, 1]] * 2, [0.9, 0.9])
    assert rasterised(hidden, camera).max() == 0


def slowly(splats, camera):
    """[H, W, 4], pixel by pixel and splat by splat."""
    width, height = camera.size_px
    turn, origin = camera.cam2world[:3, :3], camera.origin
    order = np.argsort(np.linalg.norm(splats.positions - origin, axis=1))
    left, picture = np.ones((height, width)), np.zeros((height, width, 4))
    colors, focal = splats.colors(origin), camera.K[0, 0]
    for index in order:
        x, y, z = turn.T @ (splats.positions[index] - origin)
        own = turn.T @ np.array(axis_angle_to_matrix(TURNS[index])) @ np.diag(splats.scales[index])
        jacobian = focal * np.array([[1 / z, 0, -x / z**2], [0, 1 / z, -y / z**2]])
        inverse = np.linalg.inv(jacobian @ own @ own.T @ jacobian.T + WIDENED_PX2 * np.eye(2))
        middle = np.array([focal * x / z + camera.K[0, 2], focal * y / z + camera.K[1, 2]])
        for row in range(height):
            for column in range(width):
                away = np.array([column + 0.5, row + 0.5]) - middle
                squared = away @ inverse @ away
                alpha = min(0.99, splats.opacity[index] * np.exp(-squared / 2))
                if squared <= 9 and alpha >= 1 / 255:
                    picture[row, column] += left[row, column] * alpha * np.array([*colors[index], 1])
                    left[row, column] *= 1 - alpha
    return picture


RNG = np.random.default_rng(3)
TURNS = RNG.normal(size=(12, 3))


def test_flat_splats_in_any_view_are_as_the_slow_rasteriser_draws_them():
    view = look_at(np.array([0.3, -1, 0.2]), np.zeros(3), np.array([0, 0, 1.0]))
    camera = Camera(np.array([[40.0, 0, 12], [0, 40, 9], [0, 0, 1]]), view, (25, 19))
    many = splats_of(
        0.15 * RNG.normal(size=(12, 3)),
        0.06 * RNG.random((12, 3)) * [1, 1, 0.1],
        RNG.random((12, 3)),
        0.3 + 0.6 * RNG.random(12),
        TURNS,
    )
    np.testing.assert_allclose(rasterised(many, camera), slowly(many, camera), atol=2e-4)
