"""Image files, 8-bit or linear OpenEXR: reads pixels or headers, and checks mode and size."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.readers import opened_picture
from .exr import read_exr, read_exr_header

ALPHA_MODES = ("RGBA", "LA")
"""Pillow's modes of images with alpha."""


def read_picture(path: Path, mode: str, size_px: tuple[int, int]) -> tuple[str, np.ndarray]:
    """Read an image's own mode, and its pixels [H, W, ...] uint8 in the requested mode.

    Raises:
        LiveHandError: missing, unreadable, or not of the given size.
    """
    with opened_picture(path) as image:
        own_mode, size = image.mode, image.size
        if size != tuple(size_px):
            raise LiveHandError(wrong_size(path, size_px, size))
        pixels = np.asarray(image.convert(mode))
    return own_mode, pixels


def read_linear_picture(path: Path, size_px: tuple[int, int], has_mask: bool) -> np.ndarray:
    """Read [H, W, 4] float32 of an OpenEXR file: linear colour premultiplied by alpha, and alpha (1 where it has none).

    Raises:
        LiveHandError: missing, unreadable, not of the given size, without R, G and B, not finite or with alpha outside
            [0, 1]; without alpha although it has no mask.
    """
    channels = read_exr(path)
    if not {"R", "G", "B"} <= set(channels):
        raise LiveHandError(f"{path} must have channels R, G and B, got {sorted(channels)}")
    if "A" not in channels and not has_mask:
        raise LiveHandError(no_alpha(path, "".join(sorted(channels))))
    height, width = channels["R"].shape
    if (width, height) != tuple(size_px):
        raise LiveHandError(wrong_size(path, size_px, (width, height)))
    alpha = channels.get("A", np.ones((height, width), np.float16))
    pixels = np.stack([channels["R"], channels["G"], channels["B"], alpha], -1).astype(np.float32)
    if not np.isfinite(pixels).all() or pixels[..., 3].min() < 0 or pixels[..., 3].max() > 1.001:
        raise LiveHandError(f"{path} must be finite with alpha in [0, 1], got other values")
    return pixels


def straight(pixels: np.ndarray) -> np.ndarray:
    """Return the colours [H, W, 3] of premultiplied pixels [H, W, 4] without their alpha."""
    alpha = pixels[..., 3:]
    return pixels[..., :3] / np.where(alpha > 0, alpha, 1)


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Decode sRGB-encoded values to scene-linear ones, both in [0, 1]."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(encoded.dtype)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Encode scene-linear values as sRGB, both in [0, 1]."""
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055).astype(linear.dtype)


def read_mask(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """Read [H, W] uint8: a mask's alpha if it has any, else its brightness.

    Raises:
        LiveHandError: missing, unreadable, not of the given size, or of more than 8 bits per channel.
    """
    mode, _ = read_header(path)
    if mode.startswith(("I", "F")):  # 16 and 32 bits, of which Pillow would keep the lowest 8
        raise LiveHandError(f"{path} must be a mask of 8 bits per channel, got mode {mode}; save it as an 8-bit PNG")
    if mode in ALPHA_MODES:
        return read_picture(path, "RGBA", size_px)[1][..., 3]
    return read_picture(path, "L", size_px)[1]


def read_header(path: Path) -> tuple[str, tuple[int, int]]:
    """Read an image's mode and (width, height), without decoding its pixels; OpenEXR with alpha has the mode RGBA.

    Raises:
        LiveHandError: missing, or not an image.
    """
    if path.suffix.lower() == ".exr":
        names, size_px = read_exr_header(path)
        return ("RGBA" if {"R", "G", "B", "A"} <= set(names) else "".join(names)), size_px
    with opened_picture(path) as image:
        return image.mode, image.size


def no_alpha(path: Path, mode: str) -> str:
    """Word the message for an image without alpha or mask."""
    return f"{path} must have alpha (RGBA) or a mask, got mode {mode}; `livehand mask` makes masks"


def wrong_size(path: Path, expected: tuple[int, int], size: tuple[int, int]) -> str:
    """Word the message for an image whose size differs from its camera's."""
    return f"{path} must be {tuple(expected)} px like its camera, got {size}"
