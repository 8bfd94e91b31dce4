"""Ctrl-C while Blender works."""

from __future__ import annotations

import signal
from collections.abc import Callable


class Interruption:
    """Turns Ctrl-C into a flag: Blender's render would swallow an exception and begin the next frame.

    SIGTERM, with which farms and parent processes end a run, counts as one Ctrl-C, however often it arrives. A second
    Ctrl-C raises KeyboardInterrupt at once, wherever Python is.

    Args:
        stop: called at each interruption.
    """

    def __init__(self, stop: Callable[[], None]):
        self._stop = stop
        self._is_requested = False

    def __enter__(self) -> Interruption:
        self._previous = {number: signal.signal(number, self._request) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_):
        for number, handler in self._previous.items():
            # None: a handler that is not Python's, as in the Blender program, and cannot be restored.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was an interruption."""
        if self._is_requested:
            raise KeyboardInterrupt

    def _request(self, number: int, *_):
        self._is_requested = True
        self._stop()
        if number == signal.SIGINT:
            signal.signal(signal.SIGINT, signal.default_int_handler)
