"""A camera's hands, tracked in a process of its own: the newest frame wins, here and there.

The process writes one message a frame to its standard output: a line of JSON with the landmarks, and the same frame's
picture, made small. Its standard input is a pipe that is never written to: it ends with this process, however that
ends, and the tracker's process ends with it. There is no shared memory.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..records.errors import LiveHandError
from ..system.processes import end_by_input
from .takes import FrameHands, VideoSightings, put_together
from .tracked_hand import TrackedHand
from .weights import load_networks

_END_S = 2.0  # that the process gets to end by itself
_MOST_RECORDED = 100_000
_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from backend.tracking.live_process import run; run()"


@dataclass(frozen=True)
class CameraSource:
    """A camera by its number or name, or a file that plays as if it were one."""

    name: str
    is_file: bool = False


@dataclass(frozen=True)
class LiveFrame:
    """One frame: the hands in it, and its picture.

    Attributes:
        index: of the camera's frames; some may be left out.
        time_s: from the first frame.
        taken_s: when it was taken, by `time.monotonic`.
        size_px: (width, height) of the camera's picture, in which the landmarks are.
        hands: what was tracked in it.
        picture: uint8 [h, w, 3], smaller.
    """

    index: int
    time_s: float
    taken_s: float
    size_px: tuple[int, int]
    hands: tuple[TrackedHand, ...]
    picture: np.ndarray


class LiveTracker:
    """The process, and the thread that reads what it writes.

    Raises:
        LiveHandError: the tracker's networks are not there.
    """

    def __init__(self, source: CameraSource, most_hands: int = 2, weights: Path | None = None):
        load_networks(weights)  # a missing one is an error here
        root = str(Path(__file__).parents[2])
        order = {"name": source.name, "is_file": source.is_file, "hands": most_hands}
        order["weights"] = None if weights is None else str(weights)
        path = [root, *filter(None, sys.path)]  # an empty one is the current folder
        command = [sys.executable, "-I", "-c", _START, json.dumps(path), json.dumps(order)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._changed = threading.Condition()
        self._newest: LiveFrame | None = None
        self._recorded: list[FrameHands] | None = None
        self._failure: str | None = None
        self._has_ended = False
        self._reader = threading.Thread(target=self._read, name="livehand camera", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def has_ended(self) -> bool:
        """Whether the file that plays is over, and its last frame was taken."""
        with self._changed:
            return self._has_ended and self._newest is None

    def newest(self, wait_s: float = 0.0) -> LiveFrame | None:
        """Return the newest frame, once; None if none has come since, nor within the time to wait.

        Raises:
            LiveHandError: the camera was lost, or the process has died.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest or self._failure or self._has_ended, wait_s)
            frame, self._newest = self._newest, None
            failure = self._failure
        if frame is None and failure is not None:
            raise LiveHandError(failure)
        return frame

    def record(self) -> None:
        """Keep what is seen from now on; pictures are not kept."""
        with self._changed:
            self._recorded = []

    def recorded(self) -> VideoSightings | None:
        """Return what was kept since `record`, which ends; None if nothing was."""
        with self._changed:
            kept, self._recorded = self._recorded, None
        if not kept:
            return None
        first_s = kept[0].time_s
        return put_together(frame._replace(time_s=frame.time_s - first_s) for frame in kept)

    def close(self) -> None:
        """End the process, whatever it does."""
        end_by_input(self._process, _END_S)
        self._reader.join(_END_S)

    def _read(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        with pipe:
            try:
                while line := pipe.readline():
                    self._take(json.loads(line), pipe)
            except (ValueError, KeyError, TypeError) as error:
                self._fail(f"the tracker's process must write frames, got {error}; start again")
        code = self._process.wait()
        if not self._has_ended:
            end = f"signal {-code}" if code < 0 else f"exit code {code}"
            self._fail(f"the tracker's process must go on, it ended ({end}); start again")

    def _take(self, message: dict[str, Any], pipe: IO[bytes]) -> None:
        if "error" in message:
            self._fail(message["error"])
        elif "end" in message:
            with self._changed:
                self._has_ended = True
                self._changed.notify()
        else:
            frame = _frame(message, pipe)
            with self._changed:
                self._newest = frame
                self._changed.notify()
                if self._recorded is not None and len(self._recorded) < _MOST_RECORDED:
                    self._recorded.append(FrameHands(frame.time_s, frame.size_px, frame.hands))

    def _fail(self, failure: str) -> None:
        with self._changed:
            self._failure = self._failure or failure
            self._changed.notify()


def _frame(message: dict[str, Any], pipe: IO[bytes]) -> LiveFrame:
    height, width = message["shape"]
    raw = pipe.read(height * width * 3)
    picture = np.frombuffer(raw, np.uint8).reshape(height, width, 3)
    hands = tuple(
        TrackedHand(one["track"], np.array(one["px"]), np.array(one["world"]), one["presence"], one["right"])
        for one in message["hands"]
    )
    return LiveFrame(message["index"], message["time_s"], message["taken_s"], tuple(message["size_px"]), hands, picture)
