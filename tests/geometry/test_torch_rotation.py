"""Axis-angle to matrix: closed forms, an independent exponential, and gradients where formulas divide by zero."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix, cross_matrix
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 9.99e-4, 1e-3, 1.001e-3, 0.1, 1.0, np.pi - 1e-6, np.pi, 4.0, 2 * np.pi]


def random_axes(count, seed=0):
    axes = np.random.default_rng(seed).normal(size=(count, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def test_quarter_turns_about_the_axes():
    quarter = axis_angle_to_matrix(torch.eye(3, dtype=torch.float64) * np.pi / 2)
    about_x = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    about_y = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    about_z = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(quarter, [about_x, about_y, about_z], atol=1e-15)


def test_zero_is_the_identity_exactly():
    assert torch.equal(axis_angle_to_matrix(torch.zeros(2, 3)), torch.eye(3).expand(2, 3, 3))


@pytest.mark.slow
def test_cross_matrix_is_the_cross_product():
    a, b = torch.as_tensor(random_axes(2, 5))
    torch.testing.assert_close(cross_matrix(a) @ b, torch.linalg.cross(a, b))


@pytest.mark.parametrize("angle", ANGLES)
def test_against_scipy_and_the_matrix_exponential(angle):
    vectors = random_axes(20) * angle
    ours = axis_angle_to_matrix(torch.as_tensor(vectors)).numpy()
    np.testing.assert_allclose(ours, Rotation.from_rotvec(vectors).as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_allclose(ours[0], expm(cross_matrix(torch.as_tensor(vectors[0])).numpy()), atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_orthonormal_with_determinant_one_in_single_precision(angle):
    matrices = axis_angle_to_matrix(torch.as_tensor(random_axes(50) * angle, dtype=torch.float32))
    torch.testing.assert_close(matrices @ matrices.mT, torch.eye(3).expand(50, 3, 3), atol=2e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(matrices), torch.ones(50), atol=2e-6, rtol=0)


def test_the_axis_stays_and_turning_back_undoes():
    axes = torch.as_tensor(random_axes(10))
    matrices = axis_angle_to_matrix(axes * 1.3)
    torch.testing.assert_close((matrices @ axes[..., None])[..., 0], axes)
    torch.testing.assert_close(axis_angle_to_matrix(-axes * 1.3), matrices.mT)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("angle", ANGLES)
def test_gradients_are_finite_and_right(angle, dtype):
    vector = torch.as_tensor(random_axes(1)[0] * angle, dtype=dtype).requires_grad_()
    probe = torch.as_tensor(np.random.default_rng(1).normal(size=(3, 3)), dtype=dtype)
    (axis_angle_to_matrix(vector) * probe).sum().backward()
    assert vector.grad is not None
    assert torch.isfinite(vector.grad).all()
    step = 1e-5
    moved = vector.detach().double().numpy() + step * np.concatenate([np.eye(3), -np.eye(3)])
    values = (Rotation.from_rotvec(moved).as_matrix() * probe.double().numpy()).sum((1, 2))
    np.testing.assert_allclose(
        vector.grad.double(), (values[:3] - values[3:]) / (2 * step), atol=2e-3 if dtype == torch.float32 else 1e-8
    )


def test_second_derivatives_by_gradcheck():
    vectors = torch.as_tensor(random_axes(3) * np.array([[0.3], [2.0], [1e-5]])).requires_grad_()
    assert torch.autograd.gradcheck(axis_angle_to_matrix, (vectors,))
    assert torch.autograd.gradgradcheck(axis_angle_to_matrix, (vectors[:2],))


def test_batch_axes_and_types_follow_the_input():
    vectors = torch.as_tensor(np.random.default_rng(2).normal(size=(2, 5, 3)), dtype=torch.float32)
    batch = axis_angle_to_matrix(vectors)
    assert batch.shape == (2, 5, 3, 3)
    assert batch.dtype == torch.float32
    torch.testing.assert_close(batch[1, 3], axis_angle_to_matrix(vectors[1, 3]))
