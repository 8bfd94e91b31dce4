"""Frames as PNGs or EXRs: encoded and written in threads of their own while the next frames render.

Encoding takes a sixth of a second at 1920x1080, in which a render that waits for it computes nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..capture.exr import write_exr
from ..records.errors import LiveHandError
from ..records.frame import Frame
from ..system.files import replacing
from ..system.thread_limits import usable_threads
from .decode import srgb_pixels

_MOST_THREADS = 4
_MOST_HALF = 65504.0
_WAITING_PER_THREAD = 2  # images in memory


def write_png(frame: Frame, path: Path) -> None:
    """Write a frame as sRGB with straight alpha, atomically; raises LiveHandError where it cannot be written."""
    _save(srgb_pixels(frame), path, {})


def write_frame_exr(frame: Frame, path: Path, text: Mapping[str, str] | None = None) -> None:
    """Write a frame as scene-linear premultiplied R, G, B and A of 16 bits, and Z, m, of 32; as `write_png`."""
    rgba = np.concatenate([frame.rgb, frame.alpha[..., None]], -1).clip(-_MOST_HALF, _MOST_HALF).astype(np.float16)
    write_exr(path, {name: rgba[..., k] for k, name in enumerate("RGBA")} | {"Z": frame.depth.astype(np.float32)}, text)


class _Pending(NamedTuple):
    """An image that is being written, and what to do then."""

    written: Future[None]
    then: Callable[[], None]


class FileWriter:
    """Writes PNGs as `write_png` does, and EXRs as `write_frame_exr`. Leaving the context waits until all are written.

    A frame that cannot be written raises LiveHandError at the next `write`, or when the context is left; those behind
    it are written nevertheless. What follows a frame runs in the caller's thread, in the order of the frames.

    Args:
        threads: that encode; None: as many as serve.
    """

    def __init__(self, threads: int | None = None):
        count = threads or min(_MOST_THREADS, max(1, usable_threads() // 2))
        self._most_waiting = _WAITING_PER_THREAD * count
        self._workers = ThreadPoolExecutor(count, thread_name_prefix="livehand-files")
        self._pending: deque[_Pending] = deque()

    def __enter__(self) -> FileWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._workers.shutdown(wait=True)
        failed: LiveHandError | None = None
        while self._pending:
            try:
                self._finish(0)
            except LiveHandError as error:
                failed = failed or error
        if failed and kind is None:  # else what ended the context says more
            raise failed

    def write(
        self,
        frame: Frame,
        path: Path,
        then: Callable[[], None] = lambda: None,
        text: Mapping[str, str] | None = None,
        seal: Callable[[Path], None] | None = None,
    ) -> None:
        """Write a frame soon; waits if too many are being written.

        Args:
            frame: as rendered.
            path: of the file: `.exr`, or a PNG.
            then: is called once the file is there.
            text: entries of the file's metadata.
            seal: is called with the path as soon as the file is there, in the thread that wrote it: it signs it, say.
        """
        self._finish(self._most_waiting - 1)
        if path.suffix == ".exr":
            written = self._workers.submit(_sealed, seal, path, partial(write_frame_exr, frame, path, text))
        else:
            save = partial(_save, srgb_pixels(frame), path, text or {})
            written = self._workers.submit(_sealed, seal, path, save)
        self._pending.append(_Pending(written, then))

    def _finish(self, most_left: int) -> None:
        """Follow up the images that are written, in order, and wait until at most so many are left."""
        while self._pending and (len(self._pending) > most_left or self._pending[0].written.done()):
            written, then = self._pending.popleft()
            written.result()
            then()


def _sealed(seal: Callable[[Path], None] | None, path: Path, save: Callable[[], None]) -> None:
    save()
    if seal is not None:
        seal(path)


def _save(pixels: np.ndarray, path: Path, text: Mapping[str, str]) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    entries = PngInfo()
    for key, value in text.items():
        entries.add_itxt(key, value)
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=entries)
