"""Contact sheets: pictures side by side on a neutral ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

GROUND = 0.08
ERROR_GAIN = 4.0


def comparison_sheet(pairs: Sequence[tuple[np.ndarray, np.ndarray]], triples_per_row: int = 4) -> np.ndarray:
    """[H, W, 3] uint8: for every (truth, image) [h, w, 4] premultiplied, truth | image | error x 4."""
    tiles = []
    for truth, image in pairs:
        error = np.abs(image[..., :3] - truth[..., :3]).mean(-1, keepdims=True) * ERROR_GAIN
        tiles += [on_ground(truth), on_ground(image), np.repeat(error, 3, -1)]
    return tile(tiles, 3 * triples_per_row)


def on_ground(image: np.ndarray) -> np.ndarray:
    """[h, w, 3]: premultiplied RGBA over the sheet's dark grey, in encoded colour, as viewers do."""
    return image[..., :3] + GROUND * (1 - image[..., 3:])


def tile(tiles: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """[H, W, 3] uint8: equally large tiles [h, w, 3] in [0, 1], row by row; missing ones are black."""
    height, width = tiles[0].shape[:2]
    rows = -(-len(tiles) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), np.float32)
    for index, picture in enumerate(tiles):
        top, left = index // columns * height, index % columns * width
        sheet[top : top + height, left : left + width] = picture
    return (sheet.clip(0, 1) * 255 + 0.5).astype(np.uint8)


def save_sheet(sheet: np.ndarray, path: Path) -> None:
    """Write a sheet; its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(sheet).save(path)
