"""Decoded windows of training images, so that a step never waits for a picture to be decoded twice.

From the first request on, threads decode all windows in order, while whoever asks for one that is not there yet decodes
it on the spot; either way each is decoded once. What is kept is 4 bytes a pixel: in memory up to a budget, beyond it in
a nameless file beside the images, mapped into memory, so that the system's own cache decides what stays. Where neither
has room, the rest is decoded again whenever it is asked for.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
import weakref
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from time import perf_counter

import numpy as np

BUDGET_BYTES = 4 << 30
"""Of memory."""
_THREADS = 2
_DISK_SHARE = 0.5  # of what is free that may be taken


class _State(Enum):
    UNREAD = 0
    IN_WORK = 1
    READY = 2


class CropStore:
    """Windows of N images.

    Args:
        sizes_px: (width, height) of each window.
        decode: reads window `i`: [height, width, 4] uint8. Called from several threads, once per window that is kept.
        folder: where the file may lie.
        budget_bytes: of memory.
    """

    def __init__(
        self,
        sizes_px: Sequence[tuple[int, int]],
        decode: Callable[[int], np.ndarray],
        folder: Path,
        budget_bytes: int = BUDGET_BYTES,
    ):
        self._shelf = _Shelf(sizes_px, decode, folder, budget_bytes)
        self._stop = threading.Event()
        self._is_started = False
        self._waited_s = 0.0
        weakref.finalize(self, self._stop.set)

    @property
    def waited_s(self) -> float:
        """How long `get` has kept its callers, s."""
        return self._waited_s

    def get(self, index: int) -> np.ndarray:
        """[height, width, 4] uint8 of window `index`; not to be written to.

        Raises:
            whatever `decode` raises.
        """
        self._start()
        before = perf_counter()
        try:
            return self._shelf.get(index)
        finally:
            self._waited_s += perf_counter() - before

    def _start(self) -> None:
        if self._is_started:
            return
        self._is_started = True
        for first in range(_THREADS):
            # They know the shelf, not the store: a store that is dropped ends them.
            threading.Thread(target=_fill, args=(self._shelf, first, self._stop), daemon=True).start()


def _fill(shelf: _Shelf, first: int, stop: threading.Event) -> None:
    for index in range(first, shelf.kept, _THREADS):
        if stop.is_set():
            return
        try:
            shelf.fetch(index)
        except Exception:  # whoever asks for this window is told
            continue


class _Shelf:
    """The windows' bytes, and which of them are there."""

    def __init__(
        self,
        sizes_px: Sequence[tuple[int, int]],
        decode: Callable[[int], np.ndarray],
        folder: Path,
        budget_bytes: int,
    ):
        self._shapes = [(height, width, 4) for width, height in sizes_px]
        self._ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self._shapes)], dtype=np.int64)
        self._decode = decode
        self._bytes = _room_for(int(self._ends[-1]), folder, budget_bytes)
        self.kept = int(np.searchsorted(self._ends, len(self._bytes), side="right")) - 1
        self._states = [_State.UNREAD] * self.kept
        self._changed = threading.Condition()

    def get(self, index: int) -> np.ndarray:
        if index >= self.kept:
            return self._decode(index)
        self.fetch(index, is_wanted=True)
        return self._place(index)

    def fetch(self, index: int, is_wanted: bool = False) -> None:
        """Decode a window that nobody has; one that another thread is at is waited for where it is wanted."""
        with self._changed:
            while is_wanted and self._states[index] is _State.IN_WORK:
                self._changed.wait()
            if self._states[index] is not _State.UNREAD:
                return
            self._states[index] = _State.IN_WORK
        outcome = _State.UNREAD
        try:
            self._place(index)[:] = self._decode(index)
            outcome = _State.READY
        finally:
            with self._changed:
                self._states[index] = outcome
                self._changed.notify_all()

    def _place(self, index: int) -> np.ndarray:
        return self._bytes[self._ends[index] : self._ends[index + 1]].reshape(self._shapes[index])


def _room_for(size: int, folder: Path, budget_bytes: int) -> np.ndarray:
    """Bytes for all windows or, where there is no room, for as many as the budget holds."""
    if size > budget_bytes and size < _DISK_SHARE * shutil.disk_usage(folder).free:
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                return np.memmap(file, np.uint8, "w+", shape=(size,))
        except OSError:
            pass  # a folder that cannot be written to
    return np.zeros(min(size, budget_bytes), np.uint8)
