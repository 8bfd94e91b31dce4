"""The kernels are compiled in the background, once after an install: no first picture waits for them unexplained."""

from __future__ import annotations

import importlib.util

import bpy

from ...backend.system.child_job import ChildJob, JobProgress
from ...backend.system.packages import missing_requirements

_TITLE = "Preparing LiveHand (once)"


class Preparation:
    """The process that compiles the kernels; none before it is needed, and after it has been."""

    def __init__(self):
        self._job: ChildJob | None = None

    def start(self) -> None:
        """Start the process, if the packages are there and the kernels are not."""
        if self._job is not None or missing_requirements() or importlib.util.find_spec("numba") is None:
            return
        from ...backend.compute.kernels.cache_folder import is_prepared

        if not is_prepared():
            self._job = ChildJob.start("preparing LiveHand", "render.session", None)

    @property
    def progress(self) -> JobProgress | None:
        """What users are told; None while nothing is prepared."""
        if self._job is None or not self._job.is_running:
            return None
        return JobProgress(f"{_TITLE}: {self._job.progress.text}", self._job.progress.share)

    def stop(self) -> None:
        """End the process; what it has compiled is kept."""
        if self._job is not None:
            self._job.cancel()


def draw_preparation(layout: bpy.types.UILayout, now: JobProgress | None) -> None:
    """Draw how far the preparation is, if there is one."""
    if now is not None:
        layout.progress(text=now.text, factor=now.share or 0.0)
