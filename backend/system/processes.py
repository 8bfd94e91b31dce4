"""Processes: who they are, whether they have ended, and which signals they hear.

Linux and macOS have SIGTERM, sent by farms and parent processes, and SIGHUP, sent when a terminal or a session closes;
Windows has SIGBREAK for both. One that this process was started to ignore, as `nohup` does with SIGHUP, stays ignored.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import socket
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable, Generator
from pathlib import Path

_OF_BACKGROUND = 10


def process_space() -> str:
    """Identify where a process id is valid: this machine since it was started, or this container."""
    if sys.platform == "linux":
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.readlink('/proc/self/ns/pid')}"
    return f"{socket.gethostname()} {uuid.getnode():x}"


def end_by_input(process: subprocess.Popen[bytes], patience_s: float) -> None:
    """End a child that ends when its standard input does; one that has not by then is killed."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def give_way() -> None:
    """Let other processes of the user's go first; Windows has no such call."""
    if hasattr(os, "nice"):
        os.nice(_OF_BACKGROUND)


def is_running(pid: int) -> bool:
    """Return whether there may be such a process in this space; True on Windows, which has no harmless way to ask."""
    if os.name == "nt":
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def process_name() -> str:
    """Name this process for files: eight digits for its space, and its id."""
    return f"{_space_digits()}-{os.getpid()}"


def has_ended(name: str) -> bool:
    """Return whether the process of a name from `process_name` is known not to run any more."""
    space, _, pid = name.partition("-")
    return space == _space_digits() and pid.isdecimal() and not is_running(int(pid))


def _space_digits() -> str:
    return hashlib.sha256(process_space().encode()).hexdigest()[:8]


_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def stop_signals() -> tuple[signal.Signals, ...]:
    """List those of this system that are not ignored."""
    present = (signal.Signals[name] for name in _NAMES if name in signal.Signals.__members__)
    return tuple(number for number in present if signal.getsignal(number) is not signal.SIG_IGN)


@contextlib.contextmanager
def on_stop_signals(handle: Callable[[int], None]) -> Generator[None, None, None]:
    """Call `handle` within, with the number of every signal that asks to stop, in the main thread."""
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
    """Raise KeyboardInterrupt within for every signal that asks to stop: Ctrl-C always, the others once."""
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
