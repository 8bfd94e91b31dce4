"""The kernels are compiled in the background, once after an install: no first picture waits for them unexplained."""

from __future__ import annotations

import importlib.util

import bpy

from ...backend.system.child_job import ChildJob, JobProgress
from ...backend.system.packages import missing_requirements

_TITLE = "Preparing LiveHand (once)"


class Preparation:
    """The processes that compile the kernels; none before they are needed, and after they have been.

    Views wait until the first ones have what a coarse picture needs, which they share. These go on with what a
    finished one needs, and one more compiles the rest.
    """

    def __init__(self):
        self._first: tuple[ChildJob, ...] = ()
        self._last: ChildJob | None = None

    def go_on(self) -> bool:
        """Start what is to be done next, if the packages are there and the kernels are not.

        Returns whether there will be more to do.
        """
        if self._last is not None or any(job.is_running for job in self._first):
            return self._last is None
        if not self._first and not _is_needed():
            return False
        from ...backend.render.ahead import job

        if self._first:
            self._last = _start(job.LAST_REQUEST)
        else:
            self._first = tuple(map(_start, job.first_requests()))
        return self._last is None

    @property
    def progress(self) -> JobProgress | None:
        """What users are told; None while no view has to wait."""
        if not any(map(_is_awaited, self._first)):
            return None
        share = sum(job.progress.share or 0.0 for job in self._first)  # of all kernels each
        return JobProgress(f"{_TITLE}: {share:.0%}", share)

    def stop(self) -> None:
        """End the processes; what they have compiled is kept."""
        for one in filter(None, (*self._first, self._last)):
            one.cancel()


def _is_needed() -> bool:
    if missing_requirements() or importlib.util.find_spec("numba") is None:
        return False
    from ...backend.compute.kernels.cache_folder import is_prepared

    return not is_prepared()


def _is_awaited(process: ChildJob) -> bool:
    """Return whether views wait for one of the first processes."""
    from ...backend.render.ahead import job

    return process.is_running and process.progress.text != job.READY


def _start(request: list[int] | None) -> ChildJob:
    return ChildJob.start("preparing LiveHand", "render.ahead.job", request)


def draw_preparation(layout: bpy.types.UILayout, now: JobProgress | None) -> None:
    """Draw how far the preparation is, if there is one."""
    if now is not None:
        layout.progress(text=now.text, factor=now.share or 0.0)
