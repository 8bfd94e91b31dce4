"""The part of a picture that shows a hand, as an image with a camera of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from PIL import Image

from ...records.camera import Camera

LONGEST_PX = 512
"""The longer side of a hand in its image; larger ones are made smaller."""
_MARGIN = 0.12  # of the hand's longer side, on each side
_LEAST_PX = 8
_FARTHEST = 1.0  # of the window's longer side, beyond it: an arm is as long as a hand


class Window(NamedTuple):
    """A rectangle of whole pixels, of which a part may lie beyond the picture.

    Attributes:
        x: of the upper left pixel.
        y: of that pixel.
        size_px: (width, height).
        share: size of its image against its own, at most 1.
    """

    x: int
    y: int
    size_px: tuple[int, int]
    share: float = 1.0

    def of(self, picture: np.ndarray) -> np.ndarray:
        """Cut it out of a picture [H, W, ...]; beyond the picture, the picture's edge goes on."""
        width, height = self.size_px
        rows = (self.y + np.arange(height)).clip(0, picture.shape[0] - 1)
        columns = (self.x + np.arange(width)).clip(0, picture.shape[1] - 1)
        return picture[rows[:, None], columns]

    def image_size_px(self) -> tuple[int, int]:
        """Return the size of its image (width, height)."""
        width, height = (max(1, round(side * self.share)) for side in self.size_px)
        return width, height


def window_around(points_px: np.ndarray, size_px: tuple[int, int], longest_px: int = LONGEST_PX) -> Window:
    """Return the window around a hand's points [N, 2], with a margin, inside a picture of a size (width, height)."""
    low, high = points_px.min(0), points_px.max(0)
    margin = _MARGIN * (high - low).max()
    limit = np.array(size_px)
    first = np.clip(np.floor(low - margin), 0, limit - _LEAST_PX).astype(int)
    last = np.clip(np.ceil(high + margin), first + _LEAST_PX, limit).astype(int)
    return _window(first, last, min(1.0, longest_px / (last - first).max()))


def with_points(window: Window, points_px: np.ndarray) -> Window:
    """Enlarge a window until it holds points [N, 2] as well, also beyond the picture; its image keeps its scale."""
    first, size = np.array([window.x, window.y]), np.array(window.size_px)
    farthest = np.ceil(_FARTHEST * size.max())
    low, high = np.floor(points_px.min(0)), np.ceil(points_px.max(0))
    first, last = (
        np.clip(low, first - farthest, first).astype(int),
        np.clip(high, first + size, first + size + farthest).astype(int),
    )
    return _window(first, last, window.share)


def _window(first: np.ndarray, last: np.ndarray, share: float) -> Window:
    (x, y), (width, height) = first.tolist(), (last - first).tolist()
    return Window(x, y, (width, height), share)


def camera_of(camera: Camera, window: Window) -> Camera:
    """Return the camera of a window's image."""
    cropped, size_px = camera.cropped(window.x, window.y, window.size_px), window.image_size_px()
    shares = [after / before for after, before in zip(size_px, window.size_px, strict=True)]
    return replace(cropped, K=np.diag([*shares, 1.0]) @ cropped.K, size_px=size_px)


def image_of(picture: np.ndarray, window: Window) -> np.ndarray:
    """Return a window's image, uint8 [h, w, 3]."""
    part, size_px = window.of(picture), window.image_size_px()
    if size_px == window.size_px:
        return part
    return np.asarray(Image.fromarray(part).resize(size_px, Image.Resampling.BOX))
