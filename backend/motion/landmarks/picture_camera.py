"""Landmarks in a picture, as MediaPipe gives them beside world landmarks, and the camera that makes positions of them.

x and y are shares of the picture's width and height; z is the depth from the wrist, as a share of the width. The size
of the hand gives its distance: the palm of the model is as large as the picture shows it at that depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tan

import numpy as np

from ...records.errors import LiveHandError

_PALM = (5, 9, 13, 17)  # the knuckles of the four fingers, beside the wrist, 0
_WRIST_PLANE = 1e-3  # share of the hand's extent in which z is taken for the wrist's own plane
_MARGIN, _MOST = 0.5, 0.9  # a hand may leave the picture by a part of its extent, and in some frames by more
_LARGEST_DEG = 179.0
_LEAST_FRAMES, _MOVES = 3, 0.02  # of a recording, and share of the hand's extent, to tell that its wrist moves


@dataclass(frozen=True)
class PictureCamera:
    """The camera of the tracked picture, with its principal point in the middle.

    Attributes:
        size_px: (width, height).
        fov_deg: horizontal angle of view.

    Raises:
        LiveHandError: the size or the angle is not a picture's.
    """

    size_px: tuple[int, int]
    fov_deg: float

    def __post_init__(self):
        if min(self.size_px) < 1 or not 0 < self.fov_deg <= _LARGEST_DEG:
            raise LiveHandError(
                f"a picture's camera must have a size and an angle of view of 0 to {_LARGEST_DEG:g} degrees, "
                f"got {self.size_px} px and {self.fov_deg}"
            )

    @property
    def focal_px(self) -> float:
        """The focal length."""
        return self.size_px[0] / 2 / tan(radians(self.fov_deg) / 2)


def lifted(points: np.ndarray, camera: PictureCamera, palm_m: float) -> np.ndarray:
    """Return [N, 21, 3] m in the camera's axes (OpenCV's) of picture landmarks [N, 21, 3].

    Args:
        points: shares of the picture, z from the wrist.
        camera: of the picture.
        palm_m: mean distance from the wrist to the four knuckles.

    Raises:
        LiveHandError: a hand has no extent.
    """
    width, height = camera.size_px
    shown_px = points * (width, height, width)
    palm_px = np.linalg.norm(shown_px[:, _PALM] - shown_px[:, :1], axis=-1).mean(1)
    if not (palm_px > 0).all():
        raise LiveHandError("picture landmarks must show a hand of some size, got points in one place")
    metres_per_px = (palm_m / palm_px)[:, None]
    depth_m = metres_per_px * (camera.focal_px + shown_px[..., 2])
    across = (shown_px[..., :2] - np.array(camera.size_px) / 2) / camera.focal_px
    return np.concatenate([across * depth_m[..., None], depth_m[..., None]], -1)


def looks_like_picture(points: np.ndarray) -> bool:
    """Tell whether unnamed coordinates [N, 21, 3] are a picture's: the wrist's depth is 0, and the hand lies in it.

    World landmarks lie around 0, and a tracker's wrist has a depth.
    """
    extent = np.ptp(points, axis=1).max(-1)
    is_flat = np.abs(points[:, 0, 2]) < _WRIST_PLANE * extent
    centre = points[..., :2].mean(1)
    is_inside = ((centre > 0) & (centre < 1)).all(1) & (points[..., :2].min((1, 2)) > -_MARGIN * extent)
    return bool(is_flat.all() and is_inside.mean() > _MOST)


def is_shifted_picture(points: np.ndarray) -> bool:
    """Tell whether coordinates [N, 21, 3] were a picture's once: the wrist moves, but never in depth."""
    extent = float(np.median(np.ptp(points, axis=1).max(-1)))
    x, y, depth = np.ptp(points[:, 0], axis=0)
    is_flat = depth < _WRIST_PLANE * extent and max(x, y) > _MOVES * extent
    return bool(is_flat and len(points) >= _LEAST_FRAMES)
