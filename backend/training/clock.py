"""Wall-clock time of training: the time spent, the share of it spent waiting for images, and recurring intervals."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic


class Clock:
    """Measures the seconds that a training has taken, over all its sessions.

    Args:
        spent_s: time of the sessions before this one.
        now: returns the current time, s.

    Attributes:
        waiting_s: time of this session spent waiting for images.
    """

    def __init__(self, spent_s: float = 0.0, now: Callable[[], float] = monotonic):
        self.spent_s, self.waiting_s = spent_s, 0.0
        self._now, self._start = now, now()

    @property
    def session_s(self) -> float:
        """Time since this clock was made."""
        return self._now() - self._start

    @property
    def total_s(self) -> float:
        """Time of this session and of the sessions before it."""
        return self.spent_s + self.session_s

    @property
    def data_wait_share(self) -> float:
        """Share of this session's time spent waiting for images."""
        return self.waiting_s / max(self.session_s, 1e-9)


class Interval:
    """Tells when a recurring action is due; never if the interval is 0."""

    def __init__(self, interval_s: float, clock: Clock):
        self._interval_s, self._clock = interval_s, clock
        self._last_s = clock.session_s

    def is_due(self) -> bool:
        """Whether the interval has passed since the last time this was true."""
        now_s = self._clock.session_s
        if not self._interval_s or now_s - self._last_s < self._interval_s:
            return False
        self._last_s = now_s
        return True
