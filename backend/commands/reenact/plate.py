"""The footage without its hand, if the camera stands still: each pixel's median over frames that do not cover it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...tracking.resting_camera import MOST_CHANGE, ground_change

_BAND_ROWS = 64  # at once, which bounds memory


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
    """Fill values [H, W, 3] where they are not known [H, W] by those of ever coarser means around them."""
    if is_known.all() or not is_known.any():
        return values
    height, width = is_known.shape
    padded = ((0, height % 2), (0, width % 2), (0, 0))
    weight = np.pad(is_known[..., None].astype(np.float32), padded)
    total = np.pad(values * is_known[..., None], padded)
    shape = (weight.shape[0] // 2, 2, weight.shape[1] // 2, 2, -1)
    counts, sums = (part.reshape(shape).sum((1, 3)) for part in (weight, total))
    coarse = filled(sums / np.maximum(counts, 1), counts[..., 0] > 0)
    back = coarse.repeat(2, 0).repeat(2, 1)[:height, :width]
    return np.where(is_known[..., None], values, back)
