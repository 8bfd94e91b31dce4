"""Rotations in numpy: there and back, scipy's values, signs."""

import math

import numpy as np
import pytest
from livehand.backend.geometry.rotation import (
    axis_angle_to_matrix,
    axis_angle_to_quaternion,
    continuous,
    matrix_to_axis_angle,
    quaternion_to_axis_angle,
    rotation_between,
)
from scipy.spatial.transform import Rotation

ANGLES = [0.0, 1e-9, 1e-4, 0.5, 2.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi]


@pytest.mark.parametrize("angle", ANGLES)
def test_rotations_there_and_back(angle):
    directions = np.random.default_rng(0).normal(size=(30, 3))
    for direction in [*directions, *np.eye(3), *-np.eye(3)]:
        vector = direction / np.linalg.norm(direction) * angle
        matrix = axis_angle_to_matrix(vector)
        np.testing.assert_allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
        back = matrix_to_axis_angle(matrix)
        # At pi both signs of the axis are the same rotation.
        error = min(np.abs(back - vector).max(), np.abs(back + vector).max() if angle > 3.14 else np.inf)
        assert error < 1e-7
        np.testing.assert_allclose(axis_angle_to_matrix(back), matrix, atol=1e-9)


def test_angles_beyond_pi_come_back_the_short_way():
    vector = np.array([0.0, 0.0, 1.5 * np.pi])
    np.testing.assert_allclose(matrix_to_axis_angle(axis_angle_to_matrix(vector)), [0, 0, -0.5 * np.pi], atol=1e-12)


def test_rotations_agree_with_scipy():
    directions = np.random.default_rng(6).normal(size=(800, 3))
    angles = np.random.default_rng(7).uniform(0, math.pi, (800, 1))
    theta = directions / np.linalg.norm(directions, axis=1, keepdims=True) * angles
    rotation = Rotation.from_rotvec(theta)
    np.testing.assert_allclose(axis_angle_to_matrix(theta), rotation.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrix_to_axis_angle(rotation.as_matrix()), theta, atol=1e-7)
    scipy_wxyz = rotation.as_quat(canonical=True)[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(axis_angle_to_quaternion(theta), scipy_wxyz, atol=1e-12)
    np.testing.assert_allclose(quaternion_to_axis_angle(-scipy_wxyz), theta, atol=1e-12)


def test_continuous_changes_signs_only():
    quaternions = np.array([[1.0, 0, 0, 0], [-0.9, 0.1, 0, 0], [-0.8, 0.2, 0, 0], [0.7, 0.3, 0, 0]])
    smooth = continuous(quaternions)
    np.testing.assert_array_equal(np.abs(smooth), np.abs(quaternions))
    assert ((smooth[1:] * smooth[:-1]).sum(-1) > 0).all()


def test_the_rotation_between_points_is_a_rotation_even_of_mirrored_ones():
    rng = np.random.default_rng(8)
    points, turns = rng.normal(size=(6, 3)), axis_angle_to_matrix(rng.normal(size=(4, 3)))
    np.testing.assert_allclose(rotation_between(points, points @ turns.swapaxes(-1, -2)), turns, atol=1e-12)
    assert np.linalg.det(rotation_between(points, points * [-1, 1, 1])) == pytest.approx(1)
