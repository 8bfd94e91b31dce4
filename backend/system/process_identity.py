"""Whether a process still runs, as far as each platform can say: what differs between them is here."""

from __future__ import annotations

import hashlib
import os
import socket
import sys
import uuid
from pathlib import Path


def process_space() -> str:
    """Identifies where a process id is valid: this machine since it was started, or this container."""
    if sys.platform == "linux":
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.readlink('/proc/self/ns/pid')}"
    return f"{socket.gethostname()} {uuid.getnode():x}"


def is_running(pid: int) -> bool:
    """Whether there may be such a process in this space; True on Windows, which has no harmless way to ask."""
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
    """A name of this process for files: eight digits for its space, and its id."""
    return f"{_space_digits()}-{os.getpid()}"


def has_ended(name: str) -> bool:
    """Whether the process of a name from `process_name` is known not to run any more."""
    space, _, pid = name.partition("-")
    return space == _space_digits() and pid.isdecimal() and not is_running(int(pid))


def _space_digits() -> str:
    return hashlib.sha256(process_space().encode()).hexdigest()[:8]
