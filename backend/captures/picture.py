"""Pictures on disk: read whole or by their header, checked against what they should be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..records.errors import LiveHandError

ALPHA_MODES = ("RGBA", "LA")
"""What Pillow calls pictures that carry alpha."""
# What Pillow raises of files that are missing, cut short, damaged, or larger than any photograph.
_PICTURE_ERRORS = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


def read_picture(path: Path, mode: str, size_px: tuple[int, int]) -> tuple[str, np.ndarray]:
    """A picture's own mode, and its pixels [H, W, ...] uint8 in the asked one.

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
    """[H, W] uint8: a mask's alpha where it has one, else its brightness.

    Raises:
        LiveHandError: missing, unreadable, or not of the given size.
    """
    mode, _ = read_header(path)
    if mode in ALPHA_MODES:
        return read_picture(path, "RGBA", size_px)[1][..., 3]
    return read_picture(path, "L", size_px)[1]


def read_header(path: Path) -> tuple[str, tuple[int, int]]:
    """A picture's mode and (width, height), without decoding it.

    Raises:
        LiveHandError: missing, or no picture.
    """
    try:
        with Image.open(path) as image:
            return image.mode, image.size
    except _PICTURE_ERRORS as error:
        raise LiveHandError(unreadable(path, error)) from error


def no_alpha(path: Path, mode: str) -> str:
    """What is wrong with an image that shows more than the hand."""
    return f"{path} must carry alpha (RGBA) or be given a mask, got mode {mode}; `livehand mask` makes masks"


def wrong_size(path: Path, expected: tuple[int, int], size: tuple[int, int]) -> str:
    """What is wrong with an image that its camera did not take."""
    return f"{path} must be {tuple(expected)} px as its camera says, got {size}"


def unreadable(path: Path, error: Exception) -> str:
    """What is wrong with a file that Pillow does not read."""
    return f"{path} must be a readable picture ({error})"
