"""A video's hands tracked beside Blender: by a process that reads the video or, without PyAV, Blender's own frames."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from ...backend.system.child_job import ChildJob, JobProgress
from ...backend.tracking.film_job import FilmFits, FilmRequest, read_fits, start_film
from .movie import Movie

_FITS, _FRAMES = "fits.npz", "frames"


def _nothing() -> Generator[JobProgress, None, None]:
    yield from ()


class FilmJob:
    """The job and its temporary folder, which goes with the job's end.

    Where Blender decodes the video, asking for `is_running` is what makes it go on: it decodes a few frames each time.

    Args:
        request: without an output.

    Raises:
        LiveHandError: the video cannot be read.
    """

    def __init__(self, request: FilmRequest):
        self._folder = tempfile.TemporaryDirectory(prefix="livehand_")
        self._request = replace(request, output=str(Path(self._folder.name) / _FITS))
        self._decoding: Generator[JobProgress, None, None] = _nothing()
        self._decoded = JobProgress("starting")
        self._child: ChildJob | None = None
        try:
            if importlib.util.find_spec("av") is None:
                self._decoding = self._decode(Movie(Path(request.source)))
            self._go_on()
        except BaseException:
            self._folder.cleanup()
            raise

    @property
    def progress(self) -> JobProgress:
        """What it does now."""
        return self._decoded if self._child is None else self._child.progress

    @property
    def is_running(self) -> bool:
        """Whether it has not ended; decodes a few frames, if that is not done."""
        if self._child is None:
            self._go_on()
        return self._child is None or self._child.is_running

    def wait(self) -> None:
        """Wait for the end."""
        while self._child is None:
            self._go_on()
        self._child.wait()

    def cancel(self) -> None:
        """End it, and remove what it has written."""
        self._decoding.close()
        if self._child is not None:
            self._child.cancel()
        self._folder.cleanup()

    def fits(self) -> FilmFits:
        """Return the fitted hands, after the end, and remove what was written.

        Raises:
            LiveHandError: the video cannot be read, or shows no hand.
        """
        assert self._child is not None
        try:
            self._child.result()
            return read_fits(Path(self._request.output))
        finally:
            self._folder.cleanup()

    def _go_on(self) -> None:
        """Decode a few frames more, or start the process once all are there."""
        now = next(self._decoding, None)
        if now is None:
            self._child = start_film(self._request)
        else:
            self._decoded = now

    def _decode(self, movie: Movie) -> Generator[JobProgress, None, None]:
        with closing(movie):
            folder = Path(self._folder.name) / _FRAMES
            folder.mkdir()
            for count in movie.write_frames(folder):
                yield JobProgress(f"reading frame {count} of {movie.count}", count / movie.count)
        self._request = replace(self._request, source=str(folder), fps=movie.fps)
