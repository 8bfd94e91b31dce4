"""Leases on frames: several processes and machines share an output folder and never render the same frame twice.

A claim is a hidden file beside the frame, `.wave_0001.claim`, made with O_EXCL and kept fresh by its owner. The claim
of an owner that died is not removed but outnumbered: whoever makes `.wave_0001.claim.1` first has the frame. Nobody
ever removes another's live claim, so two that take over at the same time cannot both win. Whoever has made a claim
looks again and gives way to any other live one: of two claims, the later one sees the earlier.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import sys
import tempfile
import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

from ..records.errors import LiveHandError

BEAT_S = 15.0
STALE_S = 120.0
"""A claim that was not refreshed for so long is dead, whoever made it."""
UNSIGNED_S = 1.0
"""An older claim that is empty is dead: its owner signs it right after making it, and looks again after that."""


@dataclass(frozen=True)
class Lease:
    """One frame, taken by this process.

    Attributes:
        frame: its number.
        generation: how many dead claims it outnumbers.
        path: of the claim's file.
        token: names the temporary files that are made under this claim.
    """

    frame: int
    generation: int
    path: Path
    token: str


class FrameLeases:
    """What this process has claimed of one shot's frames in one folder. A context: its end gives everything back."""

    def __init__(self, folder: Path, stem: str):
        self._folder, self._stem = folder, stem
        self._held: dict[int, Lease] = {}
        self._has_ended = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="livehand claims", daemon=True)

    def __enter__(self) -> FrameLeases:
        self._heart.start()
        return self

    def __exit__(self, *_):
        self._has_ended.set()
        self._heart.join()
        for claim in list(self._held.values()):
            self.release(claim)

    def take(self, frame: int) -> Lease | None:
        """Lease a frame; None if another live process has it.

        Raises:
            LiveHandError: the claim cannot be written.
        """
        present = self._present(frame)
        if any(map(self._is_live, present.values())):
            return None
        generation = max(present, default=-1) + 1
        claim = Lease(frame, generation, self._path(frame, generation), uuid.uuid4().hex[:8])
        if not self._make(claim):
            return None
        others = (path for other, path in self._present(frame).items() if other != generation)
        if any(map(self._is_live, others)):
            claim.path.unlink(missing_ok=True)
            return None
        self._held[frame] = claim
        return claim

    def holds(self, claim: Lease) -> bool:
        """Whether nobody took it over meanwhile, as from a process that slept for minutes."""
        return max(self._present(claim.frame), default=-1) == claim.generation

    def release(self, claim: Lease) -> None:
        """Remove the claim, and before it the dead ones that it outnumbers."""
        self._held.pop(claim.frame, None)
        for generation, path in sorted(self._present(claim.frame).items()):
            if generation <= claim.generation:
                path.unlink(missing_ok=True)

    def _path(self, frame: int, generation: int) -> Path:
        suffix = f".{generation}" if generation else ""
        return self._folder / f".{self._stem}_{frame:04d}.claim{suffix}"

    def _present(self, frame: int) -> dict[int, Path]:
        """Generation -> file of all claims on a frame."""
        first = self._path(frame, 0).name
        names = [name for name in os.listdir(self._folder) if name.startswith(first)]
        suffixes = {name: re.fullmatch(r"\.(\d+)", name.removeprefix(first)) for name in names if name != first}
        found = {int(match[1]): self._folder / name for name, match in suffixes.items() if match}
        return {0: self._folder / first} | found if first in names else found

    def _make(self, claim: Lease) -> bool:
        """Whether the file was not there, and now is."""
        owner = {"host": socket.gethostname(), "place": process_space(), "pid": os.getpid(), "time": time.time()}
        try:
            descriptor = os.open(claim.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        except FileExistsError:
            return False
        except OSError as error:
            raise _not_written(claim.path, error) from error
        try:
            with open(descriptor, "w", encoding="utf-8") as file:
                json.dump(owner, file)
        except OSError as error:
            claim.path.unlink(missing_ok=True)
            raise _not_written(claim.path, error) from error
        return True

    def _is_live(self, path: Path) -> bool:
        """Whether the claim's owner may still be at work."""
        try:
            text, age_s = path.read_text(encoding="utf-8"), self._now_s() - path.stat().st_mtime
        except FileNotFoundError:
            return False
        try:
            owner = json.loads(text)
        except ValueError:
            return age_s < UNSIGNED_S
        if owner["place"] == process_space() and not _runs(owner["pid"]):
            return False
        return age_s < STALE_S

    def _now_s(self) -> float:
        """The time by the clock that dates the folder's files, which may be another machine's."""
        with tempfile.TemporaryFile(dir=self._folder) as file:
            return os.fstat(file.fileno()).st_mtime

    def _beat(self) -> None:
        while not self._has_ended.wait(BEAT_S):
            for claim in list(self._held.values()):
                with contextlib.suppress(OSError):
                    os.utime(claim.path)


def process_space() -> str:
    """Where a process number means something: this machine since it was started, this container."""
    if sys.platform == "linux":
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.readlink('/proc/self/ns/pid')}"
    return f"{socket.gethostname()} {uuid.getnode():x}"


def _runs(pid: int) -> bool:
    """Whether there is such a process; on Windows nobody can be asked without harm, so the claim's age decides."""
    if os.name == "nt":
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _not_written(path: Path, error: OSError) -> LiveHandError:
    return LiveHandError(f"{path} could not be written: {error.strerror}; make room, and run the same command again")
