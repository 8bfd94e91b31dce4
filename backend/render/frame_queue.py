"""Renders frames in threads of its own, so that Blender evaluates, encodes and writes meanwhile.

While frame n is rendered, the tasks of frame n + 1 may be prefetched: their render goes on while Blender writes n. It
begins at once if the renderer gains by that (`HandRenderer.frames_at_once`), and each frame then has its share of the
threads; else it begins when that of n ends. Only tasks, which are plain values, cross to the threads; bpy belongs to
the main thread, and so do all methods here. A prefetched task is a guess. Its frame is used only for a submitted task
that is equal to the last bit; any other task is rendered as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext

from ..records.errors import LiveHandError
from ..system.thread_limits import thread_limit, usable_threads
from .frame_task import ExposureFrames, FrameTask

# After this many wrong guesses in a row, prefetching costs renders and saves none.
_MAX_MISSES = 2
_AT_ONCE = 2


class FrameQueue:
    """Renders the current frame and the next one. Leaving the context stops what still runs.

    Attributes:
        submitted: the tasks of the current frame, each once.
    """

    def __init__(self):
        self.submitted: list[FrameTask] = []
        self._is_stopped = False
        self._one_by_one = ThreadPoolExecutor(1, thread_name_prefix="livehand-queue")
        self._at_once = ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="livehand-queue")
        self._threads = usable_threads()
        self._renders: list[_Render] = []
        self._frame: int | None = None
        self._next_frame: int | None = None
        self._misses = 0

    def __enter__(self) -> FrameQueue:
        return self

    def __exit__(self, *_):
        self.stop()
        self._one_by_one.shutdown()
        self._at_once.shutdown()

    def stop(self) -> None:
        """Make every result an error from now on, and stop the running render soon. A signal handler may call this."""
        self._is_stopped = True

    def begin(self, frame: int, next_frame: int | None) -> None:
        """Make `frame` the current one; `next_frame` comes after it (None: nothing is to be rendered after it)."""
        self._frame, self._next_frame, self.submitted = frame, next_frame, []
        for render in self._renders:
            if render.frame != frame:
                render.cancel()
        self._renders = [render for render in self._renders if render.frame == frame]

    @property
    def prefetchable_frame(self) -> int | None:
        """The frame whose tasks are worth passing to `prefetch`; None if there is none."""
        return self._next_frame if self._misses < _MAX_MISSES else None

    def prefetch(self, task: FrameTask) -> None:
        """Render, after the current frame, a task that `prefetchable_frame` will probably submit."""
        if self._next_frame is not None and not self._find(self._next_frame, task):
            self._add(self._next_frame, task)

    def submit(self, task: FrameTask) -> Future[tuple[ExposureFrames, ...]]:
        """Return the result of a task of this frame, prefetched or not; it holds the renderer's error, if any."""
        if not any(task.is_same_as(other) for other in self.submitted):
            self.submitted.append(task)
        found = self._find(self._frame, task)
        if any(render.frame == self._frame for render in self._renders):
            self._misses = 0 if found else self._misses + 1
        return (found or self._add(self._frame, task)).result

    def _find(self, frame: int | None, task: FrameTask) -> _Render | None:
        return next((r for r in self._renders if r.frame == frame and r.task.is_same_as(task)), None)

    def _add(self, frame: int | None, task: FrameTask) -> _Render:
        workers, threads = self._one_by_one, None
        if min(task.frames_at_once, self._threads) >= _AT_ONCE:
            is_last = self._next_frame is None
            workers, threads = self._at_once, self._threads if is_last else self._threads // _AT_ONCE
        render = _Render(frame, task, workers, threads, lambda: self._is_stopped)
        self._renders.append(render)
        return render


class _Render:
    """One task in the queue; `threads` that it uses, None: as many as torch does."""

    def __init__(
        self,
        frame: int | None,
        task: FrameTask,
        workers: ThreadPoolExecutor,
        threads: int | None,
        is_queue_stopped: Callable[[], bool],
    ):
        self.frame, self.task, self._threads = frame, task, threads
        self._is_cancelled = False
        self._is_queue_stopped = is_queue_stopped
        self.result = workers.submit(self._run)

    def cancel(self) -> None:
        """Cancel the task before it begins, or end it soon: the result is not needed."""
        self._is_cancelled = True

    def _should_stop(self) -> bool:
        return self._is_cancelled or self._is_queue_stopped()

    def _limit(self) -> AbstractContextManager[None]:
        return nullcontext() if self._threads is None else thread_limit(self._threads)

    def _run(self) -> tuple[ExposureFrames, ...]:
        """Render the frames. A stopped render raises: Blender crashes if it saves a render without a result."""
        try:
            if not self._should_stop():
                with self._limit():
                    return self.task.run(self._should_stop)
        except Exception:
            if not self._should_stop():
                raise
        raise LiveHandError("the render was stopped")
