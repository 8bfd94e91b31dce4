"""Renders the newest image of every 3D view in one thread: a coarse one at once, finer ones while nothing changes.

A view's new request replaces its waiting one. The first step of a request is never stopped once it runs, however often
the view changes, so that an animation shows something new all the time and never goes back in time. Finer steps stop as
soon as any view submits a new request. Steps are plain functions without bpy.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

_PATIENCE_S = 2.0
"""For the thread's end, when the scheduler is closed."""

Step = Callable[[Callable[[], bool]], Any]
"""Takes `should_stop`, and may raise anything once that has returned True."""


@dataclass(frozen=True)
class StepOutcome:
    """The value that a step returned, or the error that it raised; the step itself, and how long it took."""

    step: Step
    seconds: float
    value: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class _Request:
    """The remaining steps of a view; `number` counts those that are done."""

    view: Hashable
    steps: tuple[Step, ...]
    number: int = 0


class PreviewScheduler:
    """One rendering thread for all views. Its methods are called from Blender's thread."""

    def __init__(self):
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="livehand-viewport")
        self._started: list[Future[None]] = []
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, _Request] = {}
        self._running: _Request | None = None
        self._outcomes: dict[Hashable, StepOutcome] = {}

    def submit(self, view: Hashable, steps: Sequence[Step]) -> None:
        """Run these steps for a view, one after the other, in place of those that still wait."""
        with self._lock:
            self._waiting[view] = _Request(view, tuple(steps))
        self._started = [future for future in self._started if not future.done()]
        self._started.append(self._thread.submit(self._work))

    def pop_outcome(self, view: Hashable) -> StepOutcome | None:
        """Take the newest outcome of a view; None if there is none since the last call."""
        with self._lock:
            return self._outcomes.pop(view, None)

    def has_outcome(self, view: Hashable) -> bool:
        """Return whether `pop_outcome` would return one."""
        with self._lock:
            return view in self._outcomes

    def is_busy(self, view: Hashable) -> bool:
        """Return whether a step of the view waits or runs."""
        with self._lock:
            return view in self._waiting or (self._running is not None and self._running.view == view)

    def is_waiting(self, view: Hashable) -> bool:
        """Return whether the first step of a request of the view waits for another step to end."""
        with self._lock:
            return view in self._waiting and self._waiting[view].number == 0

    def forget(self, view: Hashable) -> None:
        """Drop everything of a view that was closed."""
        with self._lock:
            self._waiting.pop(view, None)
            self._outcomes.pop(view, None)
            if self._running is not None and self._running.view == view:
                self._running = None

    def close(self) -> None:
        """Drop everything and end the thread; a step that does not ask whether to stop ends by itself, later."""
        with self._lock:
            self._waiting.clear()
            self._running = None
        self._thread.shutdown(wait=False, cancel_futures=True)
        wait(self._started, _PATIENCE_S)

    def _work(self) -> None:
        """Run in the thread until no step waits."""
        while request := self._begin():
            self._end(request, self._outcome(request))

    def _outcome(self, request: _Request) -> StepOutcome:
        step, start = request.steps[0], time.perf_counter()
        try:
            value, error = step(lambda: self._should_stop(request)), None
        except Exception as raised:
            value, error = None, raised
        return StepOutcome(step, time.perf_counter() - start, value, error)

    def _begin(self) -> _Request | None:
        with self._lock:
            self._running = min(self._waiting.values(), key=lambda request: request.number, default=None)
            if self._running is not None:
                del self._waiting[self._running.view]
            return self._running

    def _should_stop(self, request: _Request) -> bool:
        with self._lock:
            return self._running is not request or self._is_preempted(request)

    def _is_preempted(self, request: _Request) -> bool:
        """Return whether a finer step must give way to the first step of another request."""
        return request.number > 0 and any(other.number == 0 for other in self._waiting.values())

    def _end(self, request: _Request, outcome: StepOutcome) -> None:
        with self._lock:
            if self._running is not request:
                return
            self._running = None
            rest = request
            if not self._is_preempted(request):
                self._outcomes[request.view] = outcome
                done = len(request.steps) if outcome.error else 1
                rest = _Request(request.view, request.steps[done:], request.number + 1)
            if rest.steps:
                self._waiting.setdefault(request.view, rest)
