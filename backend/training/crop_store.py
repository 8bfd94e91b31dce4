"""Decoded crops of training images, so that no training step waits for an image to be decoded twice.

After the first request, threads decode all crops in order, and a crop that is requested before its turn is decoded at
once by the caller; either way each is decoded once. They are kept in memory up to a budget, and beyond it in a
memory-mapped file without a name in the folder of the images, which the system's file cache keeps in memory as far as
there is room. If there is no room on the disk either, the rest is decoded at every request.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

BUDGET_BYTES = 4 << 30
"""Of memory."""
DISK_SHARE = 0.5
"""Share of the free disk space that may be used."""
_THREADS = 2


class CropStore:
    """Crops of N images.

    Args:
        sizes_px: (width, height) of each crop.
        decode: reads crop `i`: [height, width, 4] of `dtype`. Called from several threads, once for each crop that is
            kept.
        folder: where the file may be written.
        budget_bytes: of memory.
        disk_share: share of the free disk space that may be used.
        dtype: of the values.
    """

    def __init__(
        self,
        sizes_px: Sequence[tuple[int, int]],
        decode: Callable[[int], np.ndarray],
        folder: Path,
        budget_bytes: int = BUDGET_BYTES,
        disk_share: float = DISK_SHARE,
        dtype: type[np.generic] = np.uint8,
    ):
        shapes = [(height, width, 4) for width, height in sizes_px]
        total = sum(int(np.prod(shape)) for shape in shapes) * np.dtype(dtype).itemsize
        self._buffer = _CropBuffer(shapes, decode, _allocated(total, folder, budget_bytes, disk_share), np.dtype(dtype))
        self._stop = threading.Event()
        self._is_started = False
        self._waited_s = 0.0
        weakref.finalize(self, self._stop.set)

    @property
    def waited_s(self) -> float:
        """Total time that `get` has taken, s."""
        return self._waited_s

    def get(self, index: int) -> np.ndarray:
        """Return crop `index` [height, width, 4]; read-only for the caller.

        Raises:
            whatever `decode` raises.
        """
        self._start_threads()
        before = perf_counter()
        try:
            return self._buffer.get(index)
        finally:
            self._waited_s += perf_counter() - before

    def _start_threads(self) -> None:
        if self._is_started:
            return
        self._is_started = True
        for first in range(_THREADS):
            # The threads hold no reference to the store, so that deleting the store ends them.
            threading.Thread(target=_decode_all, args=(self._buffer, first, self._stop), daemon=True).start()


def _decode_all(buffer: _CropBuffer, first: int, stop: threading.Event) -> None:
    for index in range(first, buffer.kept, _THREADS):
        if stop.is_set():
            return
        try:
            buffer.decode(index)
        except Exception:  # raised again for the caller that requests this crop
            continue


class _CropBuffer:
    """The bytes of the first `kept` crops, as many as fit, and which of them are decoded."""

    def __init__(
        self,
        shapes: Sequence[tuple[int, int, int]],
        decode: Callable[[int], np.ndarray],
        data: np.ndarray,
        dtype: np.dtype,
    ):
        self._shapes, self._decode, self.data, self._dtype = shapes, decode, data, dtype
        sizes = (int(np.prod(shape)) * dtype.itemsize for shape in shapes)
        self._ends = np.cumsum([0, *sizes], dtype=np.int64)
        self.kept = int(np.searchsorted(self._ends, len(data), side="right")) - 1
        self._locks = [threading.Lock() for _ in range(self.kept)]
        self._is_ready = [False] * self.kept

    def get(self, index: int) -> np.ndarray:
        if index >= self.kept:
            return self._decode(index)
        self.decode(index, wait=True)
        return self._crop(index)

    def decode(self, index: int, wait: bool = False) -> None:
        """Decode a crop unless it is ready; if another thread is decoding it, `wait` for that or return at once."""
        if not self._locks[index].acquire(blocking=wait):
            return
        try:
            if not self._is_ready[index]:
                self._crop(index)[:] = self._decode(index)
                self._is_ready[index] = True
        finally:
            self._locks[index].release()

    def _crop(self, index: int) -> np.ndarray:
        return self.data[self._ends[index] : self._ends[index + 1]].view(self._dtype).reshape(self._shapes[index])


def _allocated(size: int, folder: Path, budget_bytes: int, disk_share: float) -> np.ndarray:
    """Allocate bytes for all crops or, if there is no room, as many as the budget allows."""
    if size > budget_bytes and size < disk_share * shutil.disk_usage(folder).free:
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                return np.memmap(file, np.uint8, "w+", shape=(size,))
        except OSError:
            pass  # the folder is not writable
    return np.zeros(min(size, budget_bytes), np.uint8)
