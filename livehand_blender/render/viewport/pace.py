"""How large the pictures of a view may be while something moves, so that they keep pace with it."""

from __future__ import annotations

from collections import deque
from statistics import median

_SIDES_PX = (128, 160, 192, 224, 256, 320, 384, 448, 512)
_FIRST_PX = 256
_WANTED_S = 1 / 24
# A choice is made from several pictures: one alone may have waited for an avatar, a kernel or another program.
_FEWEST, _MOST = 3, 5
# A larger picture is tried only if it would take this share of the wanted time, so that sizes do not flicker.
_SPARE = 0.8


class Pace:
    """Chooses the longer side of moving pictures by the time that the last ones took.

    Time is taken to grow with the number of pixels. It grows less, so a smaller picture may have to be made smaller
    once more, and a larger one is never too slow for that reason.
    """

    def __init__(self, wanted_s: float = _WANTED_S):
        self._wanted_s = wanted_s
        self._side_px = _FIRST_PX
        self._seconds: deque[float] = deque(maxlen=_MOST)

    @property
    def side_px(self) -> int:
        """The longer side of the next picture."""
        return self._side_px

    def record(self, side_px: int, seconds: float) -> None:
        """Take note of the time of a picture of this longer side; one of an earlier choice does not count."""
        if side_px != self._side_px:
            return
        self._seconds.append(seconds)
        if len(self._seconds) < _FEWEST:
            return
        seconds = median(self._seconds)
        side_px = self._affordable_px(seconds)
        if side_px > self._side_px or (seconds > self._wanted_s and side_px < self._side_px):
            self._side_px = side_px
            self._seconds.clear()

    def _affordable_px(self, seconds: float) -> int:
        """The largest side with time to spare, if a picture of the present side takes so long."""
        per_pixel_s = seconds / self._side_px**2
        return max(
            (side for side in _SIDES_PX if per_pixel_s * side**2 <= _SPARE * self._wanted_s), default=_SIDES_PX[0]
        )
