"""Calls functions in Blender's main thread, the only one in which the open file's data may be saved.

In Blender's window a render runs in a thread of its own; without a window it runs in the main thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotInTime
from queue import Empty, SimpleQueue

import bpy

from ...backend.records.errors import LiveHandError

_INTERVAL_S, _TIMEOUT_S = 0.1, 30.0
_CALLS: SimpleQueue[tuple[Callable[[], None], Future[None]]] = SimpleQueue()


def call_in_main_thread(function: Callable[[], None]) -> None:
    """Call the function in the main thread and wait for its end; what it raises is raised here.

    Raises:
        LiveHandError: the main thread does not come to it.
    """
    if threading.current_thread() is threading.main_thread():
        function()
        return
    outcome: Future[None] = Future()
    _CALLS.put((function, outcome))
    try:
        outcome.result(_TIMEOUT_S)
    except NotInTime as error:
        if not outcome.cancel():  # it has begun
            outcome.result()
            return
        raise LiveHandError(
            f"Blender's interface must answer while a render prepares its light, it did not in {_TIMEOUT_S:.0f} s; "
            "close open dialogs and render again"
        ) from error


def start() -> None:
    """Serve other threads' calls, by a timer that Blender runs in its main thread."""
    if not bpy.app.background:
        bpy.app.timers.register(_serve, first_interval=_INTERVAL_S, persistent=True)


def stop() -> None:
    """Undo `start`."""
    if bpy.app.timers.is_registered(_serve):
        bpy.app.timers.unregister(_serve)


def _serve() -> float:
    try:
        while True:
            function, outcome = _CALLS.get_nowait()
            if outcome.set_running_or_notify_cancel():
                _answer(function, outcome)
    except Empty:
        return _INTERVAL_S


def _answer(function: Callable[[], None], outcome: Future[None]) -> None:
    try:
        function()
    except Exception as error:
        outcome.set_exception(error)
    else:
        outcome.set_result(None)
