"""Wall-clock time of training: what is spent, what of it on waiting for data, and what is due."""

from __future__ import annotations

from time import monotonic


class Clock:
    """Seconds that a training has taken, over all its sessions.

    Attributes:
        waiting_s: of this session, spent waiting for data.
    """

    def __init__(self, spent_s: float = 0.0):
        self._spent_s, self._start = spent_s, monotonic()
        self.waiting_s = 0.0

    @property
    def session_s(self) -> float:
        """Since this clock was made."""
        return monotonic() - self._start

    @property
    def total_s(self) -> float:
        """This session's seconds and those of the sessions before it."""
        return self._spent_s + self.session_s

    @property
    def data_wait_share(self) -> float:
        """Of this session's time."""
        return self.waiting_s / max(self.session_s, 1e-9)


class Every:
    """Says when something that recurs is due; never where the interval is 0."""

    def __init__(self, interval_s: float):
        self._interval_s, self._last = interval_s, monotonic()

    def is_due(self) -> bool:
        """Whether the interval has passed since the last time this said so."""
        now = monotonic()
        if not self._interval_s or now - self._last < self._interval_s:
            return False
        self._last = now
        return True
