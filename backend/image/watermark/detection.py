"""Reads a watermark from pictures, whatever was cut off them, and at the sizes to which they may have been resized."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image

from .signal import BITS, LEVELS, TILE, folded, half_size, luma, patterns, residual

SCALES = (1.0, 1 / 2, 2 / 3, 3 / 4, 1 / 3, 1 / 4, 3 / 2, 2.0)
"""Sizes of a picture, as shares of the rendered one, that are tried unless others are named."""
SURE = 1.6
"""Score from which there is a watermark; pictures without one have 1.2 to 1.5."""
_PHASES = ((0, 0), (0, 1), (1, 0), (1, 1))  # rows and columns, by which a crop may have moved the 2 x 2 pixels
_SMALLEST_PX, _MOST_PIXELS = 32, 12_000_000  # the latter of what is enlarged


class Reading(NamedTuple):
    """What was read of the likeliest scale and shift.

    Attributes:
        payload: 8 bytes; anything if the score is low.
        score: how much the patterns stand out there, as a multiple of their median at all shifts.
        scale: of the picture against the rendered one.
    """

    payload: bytes
    score: float
    scale: float

    @property
    def is_sure(self) -> bool:
        """Whether there is a watermark at all."""
        return self.score >= SURE

    def agreement(self, payload: bytes) -> int:
        """Count the bits that agree with a payload."""
        different = np.frombuffer(self.payload, np.uint8) ^ np.frombuffer(payload, np.uint8)
        return BITS - int(np.unpackbits(different).sum())


class WatermarkReader:
    """Reads the watermark that pictures of one size have in common, such as a film's frames.

    Codecs move the pixels of moving hands, and the watermark with them, but in frames that they compress alone. So
    those count by themselves too, and the clearer reading is taken.

    Args:
        scales: that are tried.
    """

    def __init__(self, scales: Sequence[float] = SCALES):
        self._alone = {scale: np.zeros((len(_PHASES), TILE, TILE), np.float32) for scale in scales}
        self._all = {scale: np.zeros((len(_PHASES), TILE, TILE), np.float32) for scale in scales}

    def add(self, picture: np.ndarray, is_compressed_alone: bool = True) -> None:
        """Add a picture uint8 [H, W, 3], sRGB-encoded, on black where nothing is."""
        for scale, total in self._all.items():
            resized = _rendered_size(picture, scale)
            if resized is None:
                continue
            levels = luma(resized.astype(np.float32) / np.float32(LEVELS))
            for phase, (row, column) in enumerate(_PHASES):
                sums = folded(residual(half_size(levels[row:, column:])).values)
                total[phase] += sums
                if is_compressed_alone:
                    self._alone[scale][phase] += sums

    def reading(self) -> Reading:
        """Return the clearest reading."""
        totals = [*self._alone.items(), *self._all.items()]
        return max(
            (_read(total, scale) for scale, phases in totals for total in phases), key=lambda reading: reading.score
        )


def read_watermark(picture: np.ndarray, scales: Sequence[float] = SCALES) -> Reading:
    """Read the watermark of one picture, as `WatermarkReader.add` takes it."""
    reader = WatermarkReader(scales)
    reader.add(picture)
    return reader.reading()


def _rendered_size(picture: np.ndarray, scale: float) -> np.ndarray | None:
    """Resize a picture to the size that it was rendered at; None where that cannot be."""
    height, width = picture.shape[:2]
    size = (round(width / scale), round(height / scale))
    if min(size) < _SMALLEST_PX or (scale < 1 and size[0] * size[1] > _MOST_PIXELS):
        return None
    return (
        picture
        if size == (width, height)
        else np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BICUBIC))
    )


def _read(total: np.ndarray, scale: float) -> Reading:
    """Find the shift of the tile at which all patterns stand out most, and the signs of the bits there."""
    waves = np.fft.rfft2(patterns().reshape(BITS, TILE, TILE))
    found = np.fft.irfft2(np.fft.rfft2(total)[None] * waves.conj(), s=(TILE, TILE))
    strength = np.abs(found).sum(0)
    row, column = np.unravel_index(strength.argmax(), strength.shape)
    payload = np.packbits(found[:, row, column] > 0).tobytes()
    usual = float(np.median(strength))
    return Reading(payload, float(strength.max()) / usual if usual > 0 else 0.0, scale)
