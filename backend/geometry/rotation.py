"""Rotations in numpy, for rigging and gestures; `torch_rotation` has those with gradients.

Quaternions are [..., 4] (w, x, y, z), Blender's order; axis-angle is [..., 3] rad. Any leading axes; float64 inside.
"""

from __future__ import annotations

import numpy as np


def axis_angle_to_matrix(axis_angle: np.ndarray) -> np.ndarray:
    """Compute rotation matrices [..., 3, 3] (Rodrigues); smooth at zero."""
    axis_angle = np.asarray(axis_angle, np.float64)
    angle = np.linalg.norm(axis_angle, axis=-1)[..., None, None]
    cross = np.zeros((*axis_angle.shape, 3))
    cross[..., (2, 0, 1), (1, 2, 0)] = axis_angle
    cross[..., (1, 2, 0), (2, 0, 1)] = -axis_angle
    # np.sinc(x / pi) is sin(x) / x; (1 - cos x) / x^2 is half the square of the same at x / 2.
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)


def rotation_between(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Fit the rotation [..., 3, 3] of points [..., N, 3] to others, each about its own origin (Kabsch 1976)."""
    u, _, vh = np.linalg.svd(np.swapaxes(others, -1, -2) @ points)
    u[..., -1] *= np.sign(np.linalg.det(u @ vh))[..., None]
    return u @ vh


def axis_angle_to_quaternion(axis_angle: np.ndarray) -> np.ndarray:
    """Convert to unit quaternions; smooth at zero."""
    axis_angle = np.asarray(axis_angle, np.float64)
    half = np.linalg.norm(axis_angle, axis=-1, keepdims=True) / 2
    # np.sinc(x / pi) is sin(x) / x, with its limit 1 at zero.
    return np.concatenate([np.cos(half), axis_angle / 2 * np.sinc(half / np.pi)], -1)


def quaternion_to_axis_angle(quaternion: np.ndarray) -> np.ndarray:
    """Compute axis-angle of length at most pi. At exactly pi either of the two opposite axes may come back."""
    quaternion = np.asarray(quaternion, np.float64)
    quaternion = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    vector, sine = quaternion[..., 1:], np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    is_zero = sine == 0
    angle = 2 * np.arctan2(sine, quaternion[..., :1])
    return np.where(is_zero, 2.0, angle / np.where(is_zero, 1.0, sine)) * vector


def matrix_to_quaternion(matrix: np.ndarray) -> np.ndarray:
    """Convert rotation matrices [..., 3, 3] to quaternions, by the largest of the four components (Shepperd 1978)."""
    m = np.asarray(matrix, np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    # 4 q q^T: every row is q, times four times one of its components.
    outer = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], -1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], -1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], -1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], -1),
        ],
        -2,
    )
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), -1)
    row = np.take_along_axis(outer, largest[..., None, None], -2)[..., 0, :]
    return row / np.linalg.norm(row, axis=-1, keepdims=True)


def matrix_to_axis_angle(matrix: np.ndarray) -> np.ndarray:
    """Compute axis-angle of rotation matrices [..., 3, 3]; NaN stays NaN."""
    return quaternion_to_axis_angle(matrix_to_quaternion(matrix))


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """Choose signs of the same rotations that are continuous along the first axis (time), for interpolation."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(-1, keepdims=True)
    signs = np.cumprod(np.where(dots < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs])
