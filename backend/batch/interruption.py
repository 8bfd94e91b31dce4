"""Ctrl-C while Blender works."""

from __future__ import annotations

import signal
from collections.abc import Callable


class Interruption:
    """Ctrl-C as a flag: an exception inside Blender's render would be swallowed, and the next frame begun.

    SIGTERM, by which farms and parent processes end a run, counts as one Ctrl-C, however often it comes. A second
    Ctrl-C raises KeyboardInterrupt at once, wherever Python is.

    Args:
        stop: called when it is asked for; may be called again.
    """

    def __init__(self, stop: Callable[[], None]):
        self._stop = stop
        self._is_asked = False

    def __enter__(self) -> Interruption:
        self._previous = {number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_):
        for number, handler in self._previous.items():
            # None: not one of Python's, as in the Blender program, where it can only be replaced.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if it was asked for."""
        if self._is_asked:
            raise KeyboardInterrupt

    def _ask(self, number: int, *_):
        self._is_asked = True
        self._stop()
        if number == signal.SIGINT:
            signal.signal(signal.SIGINT, signal.default_int_handler)
