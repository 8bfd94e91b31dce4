"""Writes a watermark into a picture: the patterns' amplitudes are chosen for this picture, whose own residual counts.

What the reader would find without a watermark is known here. So each bit is lifted over the same threshold, by no more
than it needs, and the threshold is the highest that the allowed change of the hand's pixels pays for.
"""

from __future__ import annotations

import numpy as np

from .signal import BITS, BYTES, LEVELS, TILE, folded, half_size, luma, patterns, residual

_RMS_LEVELS = 1.1  # of the change, over the hand's pixels
_MOST_LEVELS = 8.0
_WHITE = LEVELS - 0.5
_SOLID = 0.99  # coverage of a pixel that may change
_RESPONSE = 0.9  # of the reader's filter to a pattern
_RIDGE = 0.02  # keeps bits that a small hand cannot tell apart from asking for much
_HIGHEST, _HALVINGS = 60.0, 12


def watermarked(rgb: np.ndarray, coverage: np.ndarray, payload: bytes) -> np.ndarray:
    """Return a picture with a watermark in its hands; unchanged if it shows none.

    Args:
        rgb: [H, W, 3] scene-linear, premultiplied, of any brightness.
        coverage: [H, W] in [0, 1], how much of each pixel is hand.
        payload: 8 bytes.

    Raises:
        ValueError: the payload has another length.
    """
    if len(payload) != BYTES:
        raise ValueError(f"a payload must have {BYTES} bytes, got {len(payload)}")
    if min(coverage.shape) < 2:
        return rgb
    levels = luma(_encoded(half_size(rgb)))
    is_hand = (half_size(coverage) >= _SOLID) & (levels < _WHITE)
    change = _change(levels, is_hand, payload)
    if change is None:
        return rgb
    before = np.maximum(levels, 1.0) / LEVELS
    gain = _decoded(np.maximum(before + change / LEVELS, 0)) / _decoded(before)
    full = _full_size(gain.astype(np.float32), (coverage.shape[0], coverage.shape[1]))
    return rgb * np.where(coverage >= _SOLID, full, 1)[..., None]


def _change(levels: np.ndarray, is_hand: np.ndarray, payload: bytes) -> np.ndarray | None:
    """Compute the change of luma [h, w], levels at half size; None where no pixel may change."""
    found = residual(levels)
    place = found.weight * is_hand
    tells = folded(found.weight * place).ravel()
    if not tells.any():
        return None
    waves = patterns()
    sign = np.where(np.unpackbits(np.frombuffer(payload, np.uint8)), 1.0, -1.0)
    without = sign * (waves @ folded(found.values).ravel())
    mixed = (waves * tells) @ waves.T * _RESPONSE + np.eye(BITS) * tells.sum() * _RIDGE
    cost = (waves * folded(place**2).ravel()) @ waves.T
    inverse = np.linalg.inv(mixed.astype(np.float64))
    energy = inverse.T @ cost @ inverse
    threshold = _threshold(without, sign, energy, _RMS_LEVELS**2 * float(is_hand.sum()), float(np.sqrt(tells.sum())))
    amplitudes = inverse @ (sign * np.maximum(threshold - without, 0))
    tile = (amplitudes @ waves).reshape(TILE, TILE)
    height, width = levels.shape
    tiled = np.tile(tile, (-(-height // TILE), -(-width // TILE)))[:height, :width]
    return np.clip(tiled * place, -_MOST_LEVELS, _MOST_LEVELS)


def _threshold(without: np.ndarray, sign: np.ndarray, energy: np.ndarray, most: float, unit: float) -> float:
    """Find the highest threshold that all bits [64] can be lifted to with that much energy."""
    low, high = 0.0, _HIGHEST
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        lift = sign * np.maximum(middle * unit - without, 0)
        low, high = (middle, high) if lift @ energy @ lift < most else (low, middle)
    return low * unit


def _full_size(gain: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Interpolate [h, w] to twice its size; an odd last row or column of the picture gets ones."""
    full = np.ones(shape, np.float32)
    doubled = _doubled(_doubled(gain).T).T
    full[: doubled.shape[0], : doubled.shape[1]] = doubled
    return full


def _doubled(values: np.ndarray) -> np.ndarray:
    """Interpolate the rows [h, w] at twice their number."""
    padded = np.pad(values, ((1, 1), (0, 0)), mode="edge")
    rows = np.empty((2 * len(values), values.shape[1]), np.float32)
    rows[0::2] = 0.75 * values + 0.25 * padded[:-2]
    rows[1::2] = 0.75 * values + 0.25 * padded[2:]
    return rows


def _encoded(linear: np.ndarray) -> np.ndarray:
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, clipped * 12.92, 1.055 * clipped ** np.float32(1 / 2.4) - 0.055)


def _decoded(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
