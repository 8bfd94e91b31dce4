"""Ctrl-C while Blender works."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack

from ..system.processes import on_stop_signals


class Interruption:
    """Turns Ctrl-C into a flag: Blender's render would swallow an exception and begin the next frame.

    The other signals that ask to stop, such as SIGTERM, count as one Ctrl-C, however often they arrive. A second
    Ctrl-C raises KeyboardInterrupt at once, wherever Python is.

    Args:
        stop: called at each interruption.
    """

    def __init__(self, stop: Callable[[], None]):
        self._stop = stop
        self._is_requested = False
        self._handlers = ExitStack()

    def __enter__(self) -> Interruption:
        self._handlers.enter_context(on_stop_signals(self._request))
        return self

    def __exit__(self, *_):
        self._handlers.close()

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was an interruption."""
        if self._is_requested:
            raise KeyboardInterrupt

    def _request(self, number: int) -> None:
        self._is_requested = True
        self._stop()
        if number == signal.SIGINT:
            signal.signal(signal.SIGINT, signal.default_int_handler)
