"""The clock of a film's frames. It may jump, as an MPEG transport stream's does every 26.5 hours."""

from __future__ import annotations

LONGEST_STEP_S = 5.0
"""From a frame to the next; a longer one, or one so far back, is the clock's jump and counts as one frame."""


class FilmClock:
    """Turns the times that a file gives its frames into increasing ones from 0.

    Args:
        fps: of the film; for frames without a time, and the length of a jump.
        has_jumps: whether long steps are jumps; a camera may really pause.

    Attributes:
        jumps: how many there were.
        jump_s: the first one's length, s.
    """

    def __init__(self, fps: float, has_jumps: bool = True):
        self.jumps, self.jump_s = 0, 0.0
        self._frame_s, self._has_jumps = 1 / fps, has_jumps
        self._count, self._last = 0, -1.0
        self._start: float | None = None
        self._given = 0.0

    def time_s(self, given_s: float | None) -> float:
        """Return the time of the next frame, s; None: the file gives it none."""
        if given_s is None:
            given_s = (self._start or 0.0) + self._count * self._frame_s
        if self._start is None:
            self._start = self._given = given_s
        step = given_s - self._given
        if self._has_jumps and abs(step) > LONGEST_STEP_S:
            self.jumps, self.jump_s = self.jumps + 1, self.jump_s or step
            self._start += step - self._frame_s
        time_s = given_s - self._start
        if time_s <= self._last:  # a time that repeats or goes back
            time_s = self._last + self._frame_s
        self._given, self._last, self._count = given_s, time_s, self._count + 1
        return time_s
