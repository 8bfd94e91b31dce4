"""Memory of frames' images, taken again once nobody holds the frame that had it.

Fresh memory comes page by page, and of all of it a frame's depth is filled: at 3840x2160 that takes six times as long
as to copy the pixels of a hand.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from ..records.frame import DEPTH_BACKGROUND, Frame, empty_frame
from .crop import Crop

_MOST_BYTES = 512 << 20
"""Of memory that is kept; a frame of 3840x2160 has 166 million."""
_EMPTY = 0.0, 0.0, DEPTH_BACKGROUND


class _Images:
    """Colours, alpha and depth of one frame, all of it empty but a window."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        empty = empty_frame(size_px)
        self.arrays, self.size_px = (empty.rgb, empty.alpha, empty.depth), size_px
        self._window = slice(0, 0), slice(0, 0)
        del empty
        self._alone = self._references()

    @property
    def size_bytes(self) -> int:
        """Of all three."""
        return sum(array.nbytes for array in self.arrays)

    @property
    def is_free(self) -> bool:
        """Whether nobody else holds one of the arrays, or a view of it."""
        return self._references() == self._alone

    def _references(self) -> list[int]:
        return [sys.getrefcount(array) for array in self.arrays]

    def show(self, pixels: Sequence[np.ndarray], crop: Crop) -> None:
        """Paste a crop's pixels, of which arrays may have more rows and columns, in place of what was shown."""
        window = crop.overlap(self.size_px[::-1])
        for array, values, empty in zip(self.arrays, pixels, _EMPTY, strict=True):
            for beside in _beside(self._window, window[:2]):
                array[beside] = empty
            array[window[:2]] = values[window[2:]]
        self._window = window[:2]


def _beside(old: tuple[slice, slice], new: tuple[slice, slice]) -> list[tuple[slice, slice]]:
    """Return what of a window lies beside another, in up to four."""
    (rows, columns), (others, across) = old, new
    first, last = (min(max(row, rows.start), rows.stop) for row in (others.start, others.stop))
    left, right = (min(max(column, columns.start), columns.stop) for column in (across.start, across.stop))
    inside = slice(first, last)
    return [
        (slice(rows.start, first), columns),
        (slice(last, rows.stop), columns),
        (inside, slice(columns.start, left)),
        (inside, slice(right, columns.stop)),
    ]


class KeptImages:
    """Makes frames of pixels; one thread at a time."""

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._most_bytes, self._kept = most_bytes, list[_Images]()

    def frame(self, pixels: Sequence[np.ndarray], crop: Crop, size_px: tuple[int, int], is_lit: bool) -> Frame:
        """Return a frame of the whole image, whose arrays nobody can write, with a crop's pixels."""
        images = self._free(size_px)
        images.show(pixels, crop)
        rgb, alpha, depth = (_read_only(array) for array in images.arrays)
        return Frame(rgb, alpha, depth, is_lit=is_lit)

    def _free(self, size_px: tuple[int, int]) -> _Images:
        """Return images that nobody holds."""
        self._kept = [one for one in self._kept if one.size_px == size_px]
        for one in self._kept:
            if one.is_free:
                return one
        made = _Images(size_px)
        if made.size_bytes * (1 + len(self._kept)) <= self._most_bytes:
            self._kept.append(made)
        return made


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view
