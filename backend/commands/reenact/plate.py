"""The ground of a film without the hand: its pixels from frames that show them, the others filled from around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...tracking.resting_camera import MOST_CHANGE, ground_change

_BAND_ROWS = 64  # at once, which bounds memory
_SMALLEST, _SWEEPS, _OVER = 4, 30, 1.5  # px a side; of relaxation at each size, and by how much it goes too far


def clean_plate(pictures: Sequence[np.ndarray], covered: Sequence[np.ndarray]) -> np.ndarray | None:
    """Build the ground, uint8 [H, W, 3]; None if the camera moves.

    Args:
        pictures: uint8 [H, W, 3], frames of the footage.
        covered: [H, W] bool, where the hand may be. A pixel that is covered in all frames is filled from around it.
    """
    change = ground_change(pictures, covered)
    if change is None or change > MOST_CHANGE:
        return None
    plate = np.zeros(pictures[0].shape, np.float32)
    hidden_always = np.logical_and.reduce(covered)
    if hidden_always.all():
        return None
    for top in range(0, len(plate), _BAND_ROWS):
        rows = slice(top, top + _BAND_ROWS)
        values = np.stack([picture[rows] for picture in pictures]).astype(np.float32)
        hidden = np.stack([mask[rows] for mask in covered])
        hidden &= ~hidden_always[rows]
        values[hidden] = np.nan
        plate[rows] = np.nanmedian(values, 0)
    return filled(plate, ~hidden_always).round().astype(np.uint8)


def filled(values: np.ndarray, is_known: np.ndarray) -> np.ndarray:
    """Fill values [H, W, 3] where they are not known [H, W] harmonically: each is the mean of its neighbours.

    From a picture of half the size, filled likewise, the values are relaxed.
    """
    if is_known.all() or not is_known.any():
        return values
    height, width = is_known.shape
    start = values
    if min(height, width) > _SMALLEST:
        start = _enlarged(filled(*_halved(values, is_known)), (height, width))
    found = np.where(is_known[..., None], values, start if start is not values else values[is_known].mean(0))
    rows, columns = np.nonzero(~is_known)
    around = [
        (np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1))
        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1))
    ]
    is_even = (rows + columns) % 2 == 0
    for _ in range(_SWEEPS):
        for which in (is_even, ~is_even):
            mean = sum(found[r[which], c[which]] for r, c in around) / len(around)
            before = found[rows[which], columns[which]]
            found[rows[which], columns[which]] = before + _OVER * (mean - before)
    return found


def _halved(values: np.ndarray, is_known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the known values of each 2 x 2 px: [H / 2, W / 2, 3], and where there are any."""
    padded = ((0, is_known.shape[0] % 2), (0, is_known.shape[1] % 2), (0, 0))
    weight = np.pad(is_known[..., None].astype(np.float32), padded)
    total = np.pad(values * is_known[..., None], padded)
    shape = (weight.shape[0] // 2, 2, weight.shape[1] // 2, 2, -1)
    counts, sums = (part.reshape(shape).sum((1, 3)) for part in (weight, total))
    return (sums / np.maximum(counts, 1)).astype(np.float32), counts[..., 0] > 0


def _enlarged(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Interpolate to twice the size [H, W, 3] linearly."""
    for axis, count in enumerate(size):
        at = np.clip((np.arange(count) + 0.5) / 2 - 0.5, 0, values.shape[axis] - 1)
        low = np.floor(at).astype(int)
        high = np.minimum(low + 1, values.shape[axis] - 1)
        share = (at - low).reshape(-1, *(1,) * (2 - axis))
        values = np.take(values, low, axis) * (1 - share) + np.take(values, high, axis) * share
    return values.astype(np.float32)
