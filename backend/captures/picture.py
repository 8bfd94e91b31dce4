"""Image files: reads pixels or headers, and checks mode and size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..records.errors import LiveHandError

ALPHA_MODES = ("RGBA", "LA")
"""Pillow's modes of images with alpha."""
# Raised by Pillow for files that are missing, truncated, damaged or far too large.
_PICTURE_ERRORS = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


def read_picture(path: Path, mode: str, size_px: tuple[int, int]) -> tuple[str, np.ndarray]:
    """An image's own mode, and its pixels [H, W, ...] uint8 in the requested mode.

    Raises:
        LiveHandError: missing, unreadable, or not of the given size.
    """
    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert(mode))
            own_mode, size = image.mode, image.size
    except _PICTURE_ERRORS as error:
        raise LiveHandError(unreadable(path, error)) from error
    if size != tuple(size_px):
        raise LiveHandError(wrong_size(path, size_px, size))
    return own_mode, pixels


def read_mask(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """[H, W] uint8: a mask's alpha if it has any, else its brightness.

    Raises:
        LiveHandError: missing, unreadable, or not of the given size.
    """
    mode, _ = read_header(path)
    if mode in ALPHA_MODES:
        return read_picture(path, "RGBA", size_px)[1][..., 3]
    return read_picture(path, "L", size_px)[1]


def read_header(path: Path) -> tuple[str, tuple[int, int]]:
    """An image's mode and (width, height), without decoding its pixels.

    Raises:
        LiveHandError: missing, or not an image.
    """
    try:
        with Image.open(path) as image:
            return image.mode, image.size
    except _PICTURE_ERRORS as error:
        raise LiveHandError(unreadable(path, error)) from error


def no_alpha(path: Path, mode: str) -> str:
    """The message for an image without alpha or mask."""
    return f"{path} must have alpha (RGBA) or a mask, got mode {mode}; `livehand mask` makes masks"


def wrong_size(path: Path, expected: tuple[int, int], size: tuple[int, int]) -> str:
    """The message for an image whose size differs from its camera's."""
    return f"{path} must be {tuple(expected)} px like its camera, got {size}"


def unreadable(path: Path, error: Exception) -> str:
    """The message for a file that Pillow cannot read."""
    return f"{path} must be a readable image ({error})"
