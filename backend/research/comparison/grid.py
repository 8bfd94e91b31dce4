"""Pictures of all rows side by side: whole, a part at twice the size, and the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from ...evaluation.contact_sheet import ERROR_GAIN, label_strip, on_background, save_sheet
from ...records.errors import LiveHandError
from ...system.files import replacing
from ...system.readers import npz_bytes, read_npz

GRID, ERRORS = "grid.png", "errors.png"
_PART = 0.4  # of the picture's sides

Pair = tuple[np.ndarray, np.ndarray]


def save_pictures(pairs: Sequence[Pair], path: Path) -> None:
    """Keep a row's pictures, 8 bits, for later grids."""
    arrays = {}
    for index, pair in enumerate(pairs):
        for name, image in zip(("truth", "image"), pair, strict=True):
            arrays[f"{name}{index}"] = (image.clip(0, 1) * 255 + 0.5).astype(np.uint8)
    with replacing(path) as partial:
        partial.write_bytes(npz_bytes(arrays))


def load_pictures(path: Path) -> list[Pair]:
    """Load the pictures of a row, [H, W, 4] in [0, 1]; none if they are not there.

    Raises:
        LiveHandError: the file is damaged.
    """
    if not path.is_file():
        return []
    arrays = read_npz(path)
    names = [(f"truth{index}", f"image{index}") for index in range(len(arrays) // 2)]
    if {*arrays} != {*chain(*names)} or not all(map(_is_picture, arrays.values())):
        raise LiveHandError(f"{path} must hold a row's pictures; begin the row again with --redo")
    kept = {name: array.astype(np.float32) / 255 for name, array in arrays.items()}
    return [(kept[truth], kept[image]) for truth, image in names]


def _is_picture(array: np.ndarray) -> bool:
    return array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 4 and array.size > 0


def save_grids(rows: Mapping[str, Sequence[Pair]], folder: Path) -> None:
    """Write both grids; rows with other views than the first one's are left out.

    Args:
        rows: by label, their pictures of the same views.
        folder: of the grids.
    """
    shown = {label: pairs for label, pairs in rows.items() if pairs}
    if not shown:
        return
    first = next(iter(shown.values()))
    shapes = [truth.shape for truth, _ in first]
    shown = {label: pairs for label, pairs in shown.items() if [truth.shape for truth, _ in pairs] == shapes}
    truths = [truth for truth, _ in first]
    parts = [detailed_part(truth) for truth in truths]
    strips = [_strip("truth", truths, parts)]
    strips += [_strip(label, [image for _, image in pairs], parts) for label, pairs in shown.items()]
    save_sheet(_stacked(strips), folder / GRID)
    errors = [_strip(f"{label}, error x {ERROR_GAIN:g}", _errors(pairs), parts) for label, pairs in shown.items()]
    save_sheet(_stacked(errors), folder / ERRORS)


def detailed_part(truth: np.ndarray) -> tuple[slice, slice]:
    """Find (rows, columns) of the hand's part with most fine detail: nails and creases rather than the outline."""
    height, width = truth.shape[:2]
    rows, columns = max(2, round(height * _PART)), max(2, round(width * _PART))
    grey, alpha = truth[..., :3].mean(-1), truth[..., 3]
    step = np.zeros((height, width))
    step[1:-1, 1:-1] = np.abs(grey[2:, 1:-1] - grey[:-2, 1:-1]) + np.abs(grey[1:-1, 2:] - grey[1:-1, :-2])
    inner = np.minimum.reduce([np.roll(alpha, shift, axis) for shift in (-2, 2) for axis in (0, 1)])
    table = np.pad((step * (inner > 0.99)).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    total = table[rows:, columns:] - table[:-rows, columns:] - table[rows:, :-columns] + table[:-rows, :-columns]
    row, column = np.unravel_index(int(total.argmax()), total.shape)
    return slice(int(row), int(row) + rows), slice(int(column), int(column) + columns)


def _errors(pairs: Sequence[Pair]) -> list[np.ndarray]:
    found = [np.abs(image[..., :3] - truth[..., :3]).mean(-1, keepdims=True) * ERROR_GAIN for truth, image in pairs]
    return [np.concatenate([np.repeat(error, 3, -1), np.ones_like(error)], -1) for error in found]


def _strip(label: str, images: Sequence[np.ndarray], parts: Sequence[tuple[slice, slice]]) -> np.ndarray:
    """Set a row's pictures beside one another, each whole and beside it the part at twice its size."""
    pictures = []
    height = max(image.shape[0] for image in images)
    for image, part in zip(images, parts, strict=True):
        shown = on_background(image)
        larger = shown[part].repeat(2, 0).repeat(2, 1)[:height]
        pictures += [_filled(shown, height), _filled(larger, height)]
    strip = np.concatenate(pictures, 1)
    return np.concatenate([label_strip(label, strip.shape[1]), strip])


def _filled(picture: np.ndarray, height: int) -> np.ndarray:
    return np.pad(picture, ((0, height - picture.shape[0]), (0, 2), (0, 0)))


def _stacked(strips: Sequence[np.ndarray]) -> np.ndarray:
    width = max(strip.shape[1] for strip in strips)
    padded = [np.pad(strip, ((0, 0), (0, width - strip.shape[1]), (0, 0))) for strip in strips]
    return (np.concatenate(padded).clip(0, 1) * 255 + 0.5).astype(np.uint8)
