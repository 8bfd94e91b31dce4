"""What the watermark's writer and its reader share: the tile of patterns, and the filter that finds them.

Each bit has a pattern, random but band-limited, on a tile of 128 x 128 pixels that repeats from the picture's corner;
the sign of the bit is the sign of its pattern. Both sides work on luma at half size, whose pixels are 2 x 2 of the
picture's. Wavelengths are 6 to 10 pixels: longer ones drown in the shading, shorter ones do not outlive a JPEG.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

BITS = 64
BYTES = BITS // 8
TILE = 64
"""Side of the tile, pixels at half size."""
LEVELS = 255.0
"""Luma's white."""

_LONGEST, _SHORTEST = 13, 22  # cycles of a tile
_SEED = 0x11FE4A4D
_RADIUS = 4  # of the mean that is taken off, pixels at half size
_CLIP = 6.0  # levels: what stands out farther is an edge
_CALM = 3.0  # levels of mean residual at which a place counts half
_DARK, _DARK_RAMP = 8.0, 16.0  # levels below which there is background
_LEAST_SHARE = 0.2  # of a neighbourhood that is no background
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


class Residual(NamedTuple):
    """What the filter leaves of a picture at half size.

    Attributes:
        values: [h, w] levels times `weight`.
        weight: [h, w] in [0, 1], how much a place tells: less in the dark and beside edges.
    """

    values: np.ndarray
    weight: np.ndarray


@cache
def patterns() -> np.ndarray:
    """Make the patterns [64, TILE * TILE] of the bits: orthogonal, of mean square 1; always the same."""
    frequency = np.fft.fftfreq(TILE) * TILE
    radius = np.hypot(frequency[:, None], frequency[None])
    band = (radius >= _LONGEST) & (radius <= _SHORTEST)
    noise = np.random.Generator(np.random.PCG64(_SEED)).standard_normal((BITS, TILE, TILE))
    waves = np.fft.ifft2(np.fft.fft2(noise) * band).real.reshape(BITS, -1)
    orthogonal = np.linalg.qr(waves.T)[0].T
    signs = np.sign((orthogonal * waves).sum(1, keepdims=True))  # which LAPACK may choose
    return np.ascontiguousarray(orthogonal * signs * TILE, np.float32)


def luma(encoded: np.ndarray) -> np.ndarray:
    """Return the luma [H, W], levels, of encoded colours [H, W, 3] in [0, 1]."""
    return encoded @ (_LUMA * np.float32(LEVELS))


def half_size(image: np.ndarray) -> np.ndarray:
    """Average 2 x 2 pixels of [H, W] or [H, W, C]; an odd last row or column is left out."""
    even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
    rows = even[0::2] + even[1::2]
    return (rows[:, 0::2] + rows[:, 1::2]) / 4


def residual(levels: np.ndarray) -> Residual:
    """Filter luma [h, w], levels at half size: the mean around each pixel is taken off, background left out of it."""
    present = np.clip((levels - _DARK) / _DARK_RAMP, 0, 1)
    share = _mean(present)
    around = np.maximum(share, 1e-3)
    apart = (levels - _mean(levels * present) / around) * present
    restless = _mean(np.abs(apart)) / around
    weight = np.where(share > _LEAST_SHARE, present / (1 + restless / _CALM), 0).astype(np.float32)
    return Residual(np.clip(apart, -_CLIP, _CLIP) * weight, weight)


def folded(values: np.ndarray) -> np.ndarray:
    """Sum [h, w] over all tiles: [TILE, TILE]."""
    height, width = (-(-size // TILE) * TILE for size in values.shape)
    whole = np.zeros((height, width), np.float32)
    whole[: values.shape[0], : values.shape[1]] = values
    return whole.reshape(height // TILE, TILE, width // TILE, TILE).sum((0, 2))


def _mean(values: np.ndarray) -> np.ndarray:
    """Average [h, w] over the square around each pixel, zeros beyond the border."""
    size = 2 * _RADIUS + 1
    padded = np.pad(values, ((_RADIUS + 1, _RADIUS), (_RADIUS + 1, _RADIUS))).astype(np.float64)
    total = padded.cumsum(0).cumsum(1)
    sums = total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]
    return (sums / size**2).astype(np.float32)
