"""Contact sheets: images side by side on a dark grey background."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..system.files import replacing

BACKGROUND = 0.08
ERROR_GAIN = 4.0
_LABEL_PX, _LABEL_GREY = 15, 0.85


def comparison_sheet(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], triples_per_row: int = 4, labels: Sequence[str] | None = None
) -> np.ndarray:
    """Draw [H, W, 3] uint8: truth | image | error x 4 for every pair (truth, image) of premultiplied [h, w, 4] images.

    Smaller images lie in the upper left of the largest one's place. Labels, if given, stand above their triples.
    """
    height, width = (max(truth.shape[axis] for truth, _ in pairs) for axis in (0, 1))
    triples = []
    for index, (truth, image) in enumerate(pairs):
        error = np.abs(image[..., :3] - truth[..., :3]).mean(-1, keepdims=True) * ERROR_GAIN
        pictures = [on_background(truth), on_background(image), np.repeat(error, 3, -1)]
        triple = np.concatenate([_padded(picture, height, width) for picture in pictures], 1)
        strip = [label_strip(labels[index], 3 * width)] if labels is not None else []
        triples.append(np.concatenate([*strip, triple]))
    return tile(triples, triples_per_row)


def on_background(image: np.ndarray) -> np.ndarray:
    """Lay premultiplied RGBA over the sheet's dark grey, [h, w, 3], in encoded colour as image viewers do."""
    return image[..., :3] + BACKGROUND * (1 - image[..., 3:])


def label_strip(text: str, width: int) -> np.ndarray:
    """Return [h, width, 3] in [0, 1]: a line of light grey text, cut off at the width."""
    strip = Image.new("L", (width, _LABEL_PX + 6), round(BACKGROUND * 255))
    font = ImageFont.load_default(_LABEL_PX)
    ImageDraw.Draw(strip).text((4, 1), text, round(_LABEL_GREY * 255), font)
    return np.repeat(np.asarray(strip, np.float32)[..., None] / 255, 3, -1)


def tile(tiles: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Return [H, W, 3] uint8: tiles [h, w, 3] in [0, 1] of equal size, row by row; unused cells are black."""
    height, width = tiles[0].shape[:2]
    rows = -(-len(tiles) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), np.float32)
    for index, picture in enumerate(tiles):
        top, left = index // columns * height, index % columns * width
        sheet[top : top + height, left : left + width] = picture
    return (sheet.clip(0, 1) * 255 + 0.5).astype(np.uint8)


def save_sheet(sheet: np.ndarray, path: Path) -> None:
    """Write a sheet under a temporary name and rename it; its folder is created."""
    with replacing(path) as temporary:
        Image.fromarray(sheet).save(temporary)


def _padded(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    padding = ((0, height - picture.shape[0]), (0, width - picture.shape[1]), (0, 0))
    return np.pad(picture, padding, constant_values=BACKGROUND)
