"""Ctrl-C while Blender works."""

from __future__ import annotations

import signal


class Interruption:
    """Ctrl-C as a flag: an exception inside Blender's render would be swallowed, and the next frame begun.

    A second Ctrl-C raises KeyboardInterrupt at once, wherever Python is.
    """

    def __init__(self):
        self._is_asked = False

    def __enter__(self) -> Interruption:
        self._previous = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_):
        signal.signal(signal.SIGINT, self._previous)

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self._is_asked:
            raise KeyboardInterrupt

    def _ask(self, *_):
        self._is_asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
