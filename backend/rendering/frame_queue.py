"""Frames rendered in a thread of their own, so that Blender evaluates, encodes and writes meanwhile.

While frame n is asked for, n + 1 is foreseen and waits in the queue; its render begins when that of n ends, and goes on
while Blender writes n. Only tasks cross to the thread, which are plain values: bpy belongs to the main thread, as do
all methods here. What is foreseen is a guess. A frame is only taken for the same task, equal in every number; for any
other the task is rendered as it stands.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from ..records.errors import LiveHandError
from .frame_task import ExposureFrames, FrameTask

# After as many frames running that came otherwise than foreseen, guessing would only cost renders.
_PATIENCE = 2


class FrameQueue:
    """The frame at hand and the next one, rendered one after the other. A context: its end stops what still runs.

    Attributes:
        asked: the tasks of the frame at hand that were asked for, each once.
    """

    def __init__(self):
        self.asked: list[FrameTask] = []
        self._is_stopped = False
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="livehand-queue")
        self._renders: list[_Render] = []
        self._frame: int | None = None
        self._next_frame: int | None = None
        self._misses = 0

    def __enter__(self) -> FrameQueue:
        return self

    def __exit__(self, *_):
        self.stop()
        self._worker.shutdown()

    def stop(self) -> None:
        """Give up: every result is an error from now on, soon even that of a render that runs. A signal may call it."""
        self._is_stopped = True

    def begin(self, frame: int, next_frame: int | None) -> None:
        """From now on `frame` is asked for; `next_frame` is the one after it, None where none is to be rendered."""
        self._frame, self._next_frame, self.asked = frame, next_frame, []
        self._keep(frame)

    @property
    def prefetchable_frame(self) -> int | None:
        """The frame whose tasks are worth passing to `prefetch`; None if there is none."""
        return self._next_frame if self._misses < _PATIENCE else None

    def prefetch(self, task: FrameTask) -> None:
        """Render, when its turn has come, what `prefetchable_frame` will probably ask for."""
        if self._next_frame is not None and not self._find(self._next_frame, task):
            self._add(self._next_frame, task)

    def ask(self, task: FrameTask) -> Future[tuple[ExposureFrames, ...]]:
        """The frame at hand's result, whether foreseen or begun now; it holds the renderer's error if there was one."""
        if not any(task.is_same_as(other) for other in self.asked):
            self.asked.append(task)
        found = self._find(self._frame, task)
        guesses = [render for render in self._renders if render.frame == self._frame]
        if guesses:
            self._misses = 0 if found else self._misses + 1
        return (found or self._add(self._frame, task)).result

    def _find(self, frame: int | None, task: FrameTask) -> _Render | None:
        return next((r for r in self._renders if r.frame == frame and r.task.is_same_as(task)), None)

    def _add(self, frame: int | None, task: FrameTask) -> _Render:
        render = _Render(frame, task, self._worker, lambda: self._is_stopped)
        self._renders.append(render)
        return render

    def _keep(self, frame: int | None) -> None:
        """Stop and forget the renders of all other frames."""
        for render in self._renders:
            if render.frame != frame:
                render.stop()
        self._renders = [render for render in self._renders if render.frame == frame]


class _Render:
    """One task on its way."""

    def __init__(
        self, frame: int | None, task: FrameTask, worker: ThreadPoolExecutor, is_queue_stopped: Callable[[], bool]
    ):
        self.frame, self.task = frame, task
        self._is_unwanted = False
        self._is_queue_stopped = is_queue_stopped
        self.result = worker.submit(self._run)

    def stop(self) -> None:
        """Nobody will ask for it: do not begin it, or end it soon."""
        self._is_unwanted = True

    def _should_stop(self) -> bool:
        return self._is_unwanted or self._is_queue_stopped()

    def _run(self) -> tuple[ExposureFrames, ...]:
        """The frame's moments; an error where it was stopped: Blender crashes if it saves a render without result."""
        try:
            if not self._should_stop():
                return self.task.run(self._should_stop)
        except Exception:
            if not self._should_stop():
                raise
        raise LiveHandError("the render was stopped")
