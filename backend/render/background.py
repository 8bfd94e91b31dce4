"""Work in a thread of its own, while the caller goes on asking whether to stop and shows how far it is."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

Result = TypeVar("Result")
ShouldStop = Callable[[], bool]

INTERVAL_S = 0.05
"""Between two questions."""
_FIRST_GUESS = 64


class BackgroundWork:
    """One thread. Work that was stopped ends by itself, and what is started meanwhile waits for its end."""

    def __init__(self):
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="livehand-still")
        self._running: _Questions | None = None
        self._expected = _FIRST_GUESS

    def run(
        self,
        work: Callable[[ShouldStop], Result],
        should_stop: ShouldStop = lambda: False,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> Result | None:
        """Return what `work` returns; it raises what `work` raises. None as soon as `should_stop` returns True.

        Args:
            work: is given a function that it must query often, and end once that returns True.
            should_stop: queried in the caller's thread, whatever `work` does.
            on_progress: called in the caller's thread with a share in [0, 1): of the questions that work asked last
                time.
        """
        self._running = questions = _Questions()
        future = self._thread.submit(work, questions)
        try:
            while not wait((future,), INTERVAL_S).done:
                on_progress(min(questions.count / self._expected, 0.99))
                if should_stop():
                    return None
            if questions.count:
                self._expected = questions.count
            return future.result()
        finally:
            questions.is_stopped = True
            future.cancel()

    def close(self) -> None:
        """Stop what runs; the thread ends with it, which may be later."""
        if self._running is not None:
            self._running.is_stopped = True
        self._thread.shutdown(wait=False, cancel_futures=True)


class _Questions:
    """Whether to stop, and how often that was asked."""

    def __init__(self):
        self.is_stopped, self.count = False, 0

    def __call__(self) -> bool:
        self.count += 1
        return self.is_stopped
