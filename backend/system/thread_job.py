"""A job in a thread of this process, for input that is here; `child_job` is for what can be started anew elsewhere."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from .child_job import JobProgress, Report

Result = TypeVar("Result")
ShouldStop = Callable[[], bool]


class ThreadJob(Generic[Result]):
    """The thread, and what it has said so far.

    Args:
        name: of the job.
        work: is given a function to report its progress to, and one that tells whether it is to stop, which raises any
            exception once that is so.
    """

    def __init__(self, name: str, work: Callable[[Report, ShouldStop], Result]):
        self.progress = JobProgress("starting")
        self._work, self._is_stopping = work, threading.Event()
        self._result: Result | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=f"livehand {name}", daemon=True)
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def wait(self) -> None:
        """Wait for the end."""
        self._thread.join()

    def cancel(self) -> None:
        """Ask it to stop, and wait until it has."""
        self._is_stopping.set()
        self._thread.join()

    def result(self) -> Result:
        """Return what the work returned, after the end.

        Raises:
            BaseException: what the work raised.
        """
        self.wait()
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def _run(self) -> None:
        try:
            self._result = self._work(self._report, self._is_stopping.is_set)
        except BaseException as error:  # it is raised where the result is asked for
            self._error = error

    def _report(self, progress: JobProgress) -> None:
        self.progress = progress
