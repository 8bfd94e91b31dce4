"""The signals that ask a process to stop, and how it asks itself; systems differ in them.

Linux and macOS have SIGTERM, sent by farms and parent processes, and SIGHUP, sent when a terminal or a session closes;
Windows has SIGBREAK for both. One that this process was started to ignore, as `nohup` does with SIGHUP, stays ignored.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Generator

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def stop_signals() -> tuple[signal.Signals, ...]:
    """Those of this system that are not ignored."""
    present = (signal.Signals[name] for name in _NAMES if name in signal.Signals.__members__)
    return tuple(number for number in present if signal.getsignal(number) is not signal.SIG_IGN)


@contextlib.contextmanager
def on_stop_signals(handle: Callable[[int], None]) -> Generator[None, None, None]:
    """Inside the context, `handle` gets the number of every signal that asks to stop, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {number: signal.signal(number, lambda got, _: handle(got)) for number in stop_signals()}
    try:
        yield
    finally:
        for number, handler in previous.items():
            # None: a handler that is not Python's, as in the Blender program, and cannot be restored.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextlib.contextmanager
def stopping_as_at_ctrl_c() -> Generator[None, None, None]:
    """Inside the context, every signal that asks to stop raises KeyboardInterrupt: Ctrl-C always, the others once."""
    is_stopping = False

    def stop(number: int) -> None:
        nonlocal is_stopping
        if number == signal.SIGINT or not is_stopping:
            is_stopping = True
            raise KeyboardInterrupt

    with on_stop_signals(stop):
        yield


def ask_this_process_to_stop() -> None:
    """Make the main thread handle a SIGTERM, from any thread."""
    if os.name == "nt":  # where os.kill ends the process
        import _thread

        _thread.interrupt_main(signal.SIGTERM)
    else:
        os.kill(os.getpid(), signal.SIGTERM)
