"""Who has a lease, as its file says. Anybody can write such a file, so it may say anything."""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path
from typing import NamedTuple

from ..records.errors import LiveHandError
from ..system.json_file import read_json
from ..system.process_identity import is_running, process_space
from ..system.regular_file import is_file

_MOST_BYTES = 1 << 12
_LARGEST_PID = 1 << 31


class LeaseOwner(NamedTuple):
    """A process: its id, and the place where that id is valid."""

    place: str
    pid: int

    def has_ended(self) -> bool:
        """Whether the process is known not to run any more."""
        return self.place == process_space() and not is_running(self.pid)


def signature() -> str:
    """What this process writes into its leases."""
    owner = {"host": socket.gethostname(), "place": process_space(), "pid": os.getpid(), "time": time.time()}
    return json.dumps(owner)


def read_owner(path: Path) -> LeaseOwner | None:
    """The owner whom a lease names; None: it names none, as when it is not signed yet, or is no lease at all.

    Raises:
        PermissionError: this user may not read it.
    """
    if is_file(path) and not os.access(path, os.R_OK):
        raise PermissionError(path)
    try:
        owner = read_json(path, _MOST_BYTES)
    except LiveHandError:
        return None
    place, pid = (owner.get(key) for key in ("place", "pid")) if isinstance(owner, dict) else (None, None)
    if isinstance(place, str) and isinstance(pid, int) and 0 < pid < _LARGEST_PID:
        return LeaseOwner(place, pid)
    return None
