"""The newest picture of every view, rendered in one thread: coarse at once, finer when nothing newer is asked for.

What is asked for a view replaces what waits for it. Its first step is never stopped once it runs, however often the
view changes: so something new is shown all the time while an animation plays, and what is shown never goes back in
time. Finer steps stop as soon as any view asks for a first one. Steps are plain functions without bpy.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

Step = Callable[[Callable[[], bool]], Any]  # given `should_stop`; may raise anything after that has said so


@dataclass(frozen=True)
class StepOutcome:
    """What a step came to: its value, or what it raised."""

    value: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class _Request:
    """What is left to do for a view; `number` counts the steps that are done."""

    view: Hashable
    steps: tuple[Step, ...]
    number: int = 0


class PreviewScheduler:
    """One thread for all views. Its methods are for Blender's thread."""

    def __init__(self):
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="livehand-viewport")
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, _Request] = {}
        self._running: _Request | None = None
        self._outcomes: dict[Hashable, StepOutcome] = {}

    def ask(self, view: Hashable, steps: Sequence[Step]) -> None:
        """Run these for a view, one after the other, instead of what still waits for it."""
        with self._lock:
            self._waiting[view] = _Request(view, tuple(steps))
        self._thread.submit(self._work)

    def take(self, view: Hashable) -> StepOutcome | None:
        """The newest outcome of a view, once; None where there is none since the last."""
        with self._lock:
            return self._outcomes.pop(view, None)

    def has_news(self, view: Hashable) -> bool:
        """Whether `take` has something."""
        with self._lock:
            return view in self._outcomes

    def is_busy(self, view: Hashable) -> bool:
        """Whether something is under way for a view."""
        with self._lock:
            return view in self._waiting or (self._running is not None and self._running.view == view)

    def forget(self, view: Hashable) -> None:
        """The view is closed: drop all of its."""
        with self._lock:
            self._waiting.pop(view, None)
            self._outcomes.pop(view, None)
            if self._running is not None and self._running.view == view:
                self._running = None

    def close(self) -> None:
        """Drop everything and end the thread."""
        with self._lock:
            self._waiting.clear()
            self._running = None
        self._thread.shutdown()

    def _work(self) -> None:
        """In the thread: until nothing waits."""
        while request := self._begin():
            try:
                outcome = StepOutcome(request.steps[0](lambda request=request: self._should_stop(request)))
            except Exception as error:
                outcome = StepOutcome(error=error)
            self._end(request, outcome)

    def _begin(self) -> _Request | None:
        with self._lock:
            self._running = min(self._waiting.values(), key=lambda request: request.number, default=None)
            if self._running is not None:
                del self._waiting[self._running.view]
            return self._running

    def _should_stop(self, request: _Request) -> bool:
        with self._lock:
            return self._running is not request or self._is_outrun(request)

    def _is_outrun(self, request: _Request) -> bool:
        return request.number > 0 and any(other.number == 0 for other in self._waiting.values())

    def _end(self, request: _Request, outcome: StepOutcome) -> None:
        with self._lock:
            if self._running is not request:
                return
            self._running = None
            rest = request
            if not self._is_outrun(request):
                self._outcomes[request.view] = outcome
                done = len(request.steps) if outcome.error else 1
                rest = _Request(request.view, request.steps[done:], request.number + 1)
            if rest.steps:
                self._waiting.setdefault(request.view, rest)
