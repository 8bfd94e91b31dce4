"""Leases on frames: several processes and machines share an output folder and never render the same frame twice.

A lease is a hidden file beside the frame, `.wave_0001.claim`, created with O_EXCL and kept fresh by its owner. The
lease of a dead owner is not removed but superseded: whoever creates `.wave_0001.claim.1` first has the frame. No
process removes another's live lease, so two that take over at the same time cannot both win. After creating a lease, a
process looks again and gives way to any other live one: of two leases, the later one sees the earlier.

The files are named `.claim`, as by every version so far: processes of different versions may share a folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import tempfile
import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..records.errors import LiveHandError
from ..system.files import is_file
from ..system.processes import is_running, process_space
from ..system.readers import read_json
from .folders import not_written

_MOST_BYTES = 1 << 12
_LARGEST_PID = 1 << 31


class LeaseOwner(NamedTuple):
    """A process: its id, and the place where that id is valid."""

    place: str
    pid: int

    def has_ended(self) -> bool:
        """Return whether the process is known not to run any more."""
        return self.place == process_space() and not is_running(self.pid)


def signature() -> str:
    """Return what this process writes into its leases."""
    owner = {"host": socket.gethostname(), "place": process_space(), "pid": os.getpid(), "time": time.time()}
    return json.dumps(owner)


def read_owner(path: Path) -> LeaseOwner | None:
    """Read the owner whom a lease names; None: it names none, as when it is not signed yet, or is no lease at all.

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


REFRESH_S = 15.0
STALE_S = 120.0
"""A lease that was not refreshed for so long, by its time or as this process has seen, is dead, whoever owns it."""
UNSIGNED_S = 1.0
"""An older lease that names no owner is dead: owners sign right after creating theirs, and look again after that."""


@dataclass(frozen=True)
class Lease:
    """This process's right to render one frame.

    Attributes:
        frame: its number.
        generation: how many dead leases it supersedes.
        path: of its file.
        token: names the temporary files that are written under this lease.
    """

    frame: int
    generation: int
    path: Path
    token: str


class FrameLeases:
    """This process's leases on one shot's frames in one folder. Leaving the context releases all of them.

    Args:
        folder: of the frames.
        stem: the shot's name.
        refresh_s: how often live leases are refreshed.
    """

    def __init__(self, folder: Path, stem: str, refresh_s: float = REFRESH_S):
        self._folder, self._stem, self._refresh_s = folder, stem, refresh_s
        self._held: dict[int, Lease] = {}
        self._seen: dict[Path, tuple[int, float]] = {}  # another's lease -> its time, and since when it is seen with it
        self._has_ended = threading.Event()
        self._thread = threading.Thread(target=self._refresh, name="livehand leases", daemon=True)

    def __enter__(self) -> FrameLeases:
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._has_ended.set()
        self._thread.join()
        for lease in list(self._held.values()):
            self.release(lease)

    def acquire(self, frame: int) -> Lease | None:
        """Lease a frame; None if another live process has it.

        Raises:
            LiveHandError: the lease cannot be written.
        """
        present = self._present(frame)
        if any(map(self._is_live, present.values())):
            return None
        generation = max(present, default=-1) + 1
        lease = Lease(frame, generation, self._path(frame, generation), uuid.uuid4().hex[:8])
        if not self._create(lease):
            return None
        others = (path for other, path in self._present(frame).items() if other != generation)
        if any(map(self._is_live, others)):
            lease.path.unlink(missing_ok=True)
            return None
        self._held[frame] = lease
        return lease

    def holds(self, lease: Lease) -> bool:
        """Return whether no process has superseded the lease, as one does whose owner slept for minutes."""
        return max(self._present(lease.frame), default=-1) == lease.generation

    def is_lost(self, lease: Lease) -> bool:
        """Return whether no process has a lease on the frame any more, as after the folder was deleted."""
        return not self._present(lease.frame)

    def release(self, lease: Lease) -> None:
        """Remove the lease, and before it the dead ones that it supersedes."""
        self._held.pop(lease.frame, None)
        for generation, path in sorted(self._present(lease.frame).items()):
            if generation <= lease.generation:
                with contextlib.suppress(OSError):  # what stays is dead: of another user, or a folder
                    path.unlink(missing_ok=True)

    def _path(self, frame: int, generation: int) -> Path:
        suffix = f".{generation}" if generation else ""
        return self._folder / f".{self._stem}_{frame:04d}.claim{suffix}"

    def _present(self, frame: int) -> dict[int, Path]:
        """Map each generation of the leases on a frame to its file."""
        lease_name = re.compile(rf"{re.escape(self._path(frame, 0).name)}(?:\.(\d+))?")
        names = os.listdir(self._folder) if self._folder.is_dir() else ()
        matches = map(lease_name.fullmatch, names)
        return {int(match[1] or 0): self._folder / match[0] for match in matches if match}

    def _create(self, lease: Lease) -> bool:
        """Create the file; returns False if it exists."""
        try:
            descriptor = os.open(lease.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        except FileExistsError:
            return False
        except OSError as error:
            raise not_written(lease.path, str(error.strerror)) from error
        try:
            with open(descriptor, "w", encoding="utf-8") as file:
                file.write(signature())
        except OSError as error:
            lease.path.unlink(missing_ok=True)
            raise not_written(lease.path, str(error.strerror)) from error
        return True

    def _is_live(self, path: Path) -> bool:
        """Return whether the lease's owner may still be at work."""
        try:
            age_s = self._age_s(path)
        except FileNotFoundError:
            return False
        try:
            owner = read_owner(path)
        except PermissionError:  # another user's
            return age_s < STALE_S
        if owner is None:
            return age_s < UNSIGNED_S
        return age_s < STALE_S and not owner.has_ended()

    def _age_s(self, path: Path) -> float:
        """Measure the age of a lease, s; if its time lies in the future, how long it was seen with that time."""
        changed_ns = path.stat().st_mtime_ns
        if self._seen.get(path, (None,))[0] != changed_ns:
            self._seen[path] = (changed_ns, time.monotonic())
        return max(self._now_s() - changed_ns / 1e9, time.monotonic() - self._seen[path][1])

    def _now_s(self) -> float:
        """Read the clock that dates the folder's files, which may be another machine's."""
        with tempfile.TemporaryFile(dir=self._folder) as file:
            return os.fstat(file.fileno()).st_mtime

    def _refresh(self) -> None:
        """Run in the thread: touch all leases until the end."""
        while not self._has_ended.wait(self._refresh_s):
            for lease in list(self._held.values()):
                with contextlib.suppress(OSError):
                    os.utime(lease.path)
