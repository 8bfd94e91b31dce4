"""A pinhole camera. K and the pixel-centre convention are fixed here and nowhere else.

Axes are OpenCV's: x right, y down, z forward. The centre of pixel (column i, row j) is at (i + 0.5, j + 0.5) px.
`depth` is measured along the optical axis, `dist` along the ray; both in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import LiveHandError

_ROTATION_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Camera:
    """Intrinsics, pose and image size.

    Attributes:
        K: [3, 3] intrinsics, px.
        cam2world: [4, 4] rigid transform from OpenCV camera axes to the world, m.
        size_px: (width, height).
    """

    K: np.ndarray
    cam2world: np.ndarray
    size_px: tuple[int, int]

    def __post_init__(self):
        _check(np.shape(self.K) == (3, 3), f"K must be [3, 3] px, got {np.shape(self.K)}")
        _check(np.shape(self.cam2world) == (4, 4), f"cam2world must be [4, 4], got {np.shape(self.cam2world)}")
        _check(
            bool(np.isfinite(self.K).all() and np.isfinite(self.cam2world).all()),
            "camera matrices must be finite, got NaN or infinity",
        )
        rotation = self.cam2world[:3, :3]
        is_rotation = np.abs(rotation.T @ rotation - np.eye(3)).max() < _ROTATION_TOLERANCE
        _check(
            bool(is_rotation and _is_right_handed(rotation)),
            "the upper left of cam2world must be a rotation, got a scaled, sheared or mirrored matrix; "
            "remove the scale of the camera and of its parents",
        )
        _check(min(self.size_px) >= 1, f"size_px must be at least (1, 1), got {self.size_px}")

    @property
    def origin(self) -> np.ndarray:
        """[3] optical centre in the world, m."""
        return self.cam2world[:3, 3]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points [..., 3] m to pixels [..., 2] and depth [...] m. Depth <= 0 lies behind the camera."""
        in_camera = (points - self.origin) @ self.cam2world[:3, :3]
        homogeneous = in_camera @ self.K.T
        return homogeneous[..., :2] / homogeneous[..., 2:], in_camera[..., 2]

    def ray_directions(self, pixels_px: np.ndarray) -> np.ndarray:
        """Compute world directions [..., 3], scaled to depth 1, through the pixel positions [..., 2]."""
        ones = np.ones_like(pixels_px[..., :1])
        in_camera = np.concatenate([pixels_px, ones], -1) @ np.linalg.inv(self.K).T
        return in_camera @ self.cam2world[:3, :3].T

    def through_lens(self, offset_m: np.ndarray, focus_m: float) -> Camera:
        """Look through a point of a thin lens beside its centre; the plane of focus does not move in the image.

        Args:
            offset_m: [2] along the camera's x and y.
            focus_m: depth of the plane of focus.
        """
        K, cam2world = self.K.copy(), self.cam2world.copy()
        K[:2, 2] += K.diagonal()[:2] * offset_m / focus_m
        cam2world[:3, 3] += cam2world[:3, :2] @ offset_m
        return replace(self, K=K, cam2world=cam2world)

    def cropped(self, x0_px: int, y0_px: int, size_px: tuple[int, int]) -> Camera:
        """Crop to `size_px` with upper left pixel (x0, y0); the crop may extend outside the image."""
        shift = np.array([[1, 0, -x0_px], [0, 1, -y0_px], [0, 0, 1.0]])
        return replace(self, K=shift @ self.K, size_px=size_px)

    def scaled(self, factor: float) -> Camera:
        """Scale the same view to `factor` times the resolution (image size rounded up)."""
        width, height = (int(np.ceil(n * factor)) for n in self.size_px)
        return replace(self, K=np.diag([factor, factor, 1.0]) @ self.K, size_px=(width, height))


def look_at(origin: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Aim a camera at `target`: its cam2world [4, 4] from `origin`, with `up` towards the top of the image."""
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    cam2world = np.eye(4)
    cam2world[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    cam2world[:3, 3] = origin
    return cam2world


def _is_right_handed(axes: np.ndarray) -> bool:
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes.tolist()
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx) > 0


def _check(holds: bool, message: str) -> None:
    if not holds:
        raise LiveHandError(message)
