"""The part of a film's picture that becomes an image of a capture, and its camera."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from PIL import Image

from ...records.camera import Camera

LONGEST_PX = 512
"""The longer side of an image; larger windows are made smaller."""
_MARGIN = 0.12  # of the hand's longer side, on each side
_LEAST_PX = 8


class Window(NamedTuple):
    """A rectangle of whole pixels: the upper left one, and the size (width, height)."""

    x: int
    y: int
    size_px: tuple[int, int]

    def of(self, picture: np.ndarray) -> np.ndarray:
        """Its part of a picture [H, W, ...]."""
        width, height = self.size_px
        return picture[self.y : self.y + height, self.x : self.x + width]


def window_around(points_px: np.ndarray, size_px: tuple[int, int]) -> Window:
    """The window around a hand's points [N, 2], with a margin, inside a picture of a size (width, height)."""
    low, high = points_px.min(0), points_px.max(0)
    margin = _MARGIN * (high - low).max()
    limit = np.array(size_px)
    first = np.clip(np.floor(low - margin), 0, limit - _LEAST_PX).astype(int)
    last = np.clip(np.ceil(high + margin), first + _LEAST_PX, limit).astype(int)
    width, height = (last - first).tolist()
    return Window(int(first[0]), int(first[1]), (width, height))


def shrunk_size(size_px: tuple[int, int]) -> tuple[int, int]:
    """The size of a window's image (width, height): its own, or smaller."""
    share = min(1.0, LONGEST_PX / max(size_px))
    width, height = (max(1, round(side * share)) for side in size_px)
    return width, height


def camera_of(camera: Camera, window: Window) -> Camera:
    """The camera of a window's image."""
    cropped, size_px = camera.cropped(window.x, window.y, window.size_px), shrunk_size(window.size_px)
    shares = [after / before for after, before in zip(size_px, window.size_px, strict=True)]
    return replace(cropped, K=np.diag([*shares, 1.0]) @ cropped.K, size_px=size_px)


def image_of(picture: np.ndarray, window: Window) -> np.ndarray:
    """uint8 [h, w, 3], a window's image."""
    part, size_px = np.ascontiguousarray(window.of(picture)), shrunk_size(window.size_px)
    if size_px == window.size_px:
        return part
    return np.asarray(Image.fromarray(part).resize(size_px, Image.Resampling.BOX))
