"""A pinhole camera, or an orthographic one. K and the pixel-centre convention are fixed here and nowhere else.

Axes are OpenCV's: x right, y down, z forward. A pinhole's K takes (x / z, y / z, 1) to pixels, an orthographic camera's
takes (x, y, 1): its focal lengths are pixels per metre. The centre of pixel (column i, row j) is at
(i + 0.5, j + 0.5) px.
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
        is_orthographic: whether its rays are parallel, and begin in the plane through its centre.
    """

    K: np.ndarray
    cam2world: np.ndarray
    size_px: tuple[int, int]
    is_orthographic: bool = False

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
        depth = in_camera[..., 2]
        if self.is_orthographic:
            in_camera = np.concatenate([in_camera[..., :2], np.ones_like(depth)[..., None]], -1)
        homogeneous = in_camera @ self.K.T
        return homogeneous[..., :2] / homogeneous[..., 2:], depth

    def ray_directions(self, pixels_px: np.ndarray) -> np.ndarray:
        """Compute world directions [..., 3], scaled to depth 1, through the pixel positions [..., 2]."""
        if self.is_orthographic:
            return np.broadcast_to(self.cam2world[:3, 2], (*pixels_px.shape[:-1], 3))
        return self._through(pixels_px) @ self.cam2world[:3, :3].T

    def ray_origins(self, pixels_px: np.ndarray) -> np.ndarray:
        """Compute where the rays through the pixel positions [..., 2] have depth 0, world [..., 3], m."""
        if not self.is_orthographic:
            return np.broadcast_to(self.origin, (*pixels_px.shape[:-1], 3))
        return self.origin + self._through(pixels_px)[..., :2] @ self.cam2world[:3, :2].T

    def _through(self, pixels_px: np.ndarray) -> np.ndarray:
        ones = np.ones_like(pixels_px[..., :1])
        return np.concatenate([pixels_px, ones], -1) @ np.linalg.inv(self.K).T

    def through_lens(self, offset_m: np.ndarray, focus_m: float) -> Camera:
        """Look through a point of a thin lens beside its centre; the plane of focus does not move in the image.

        Args:
            offset_m: [2] along the camera's x and y.
            focus_m: depth of the plane of focus.

        Raises:
            LiveHandError: the camera is orthographic, which has no lens.
        """
        _check(
            not self.is_orthographic,
            "depth of field needs a perspective camera, got an orthographic one; turn its depth of field off",
        )
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
