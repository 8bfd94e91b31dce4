"""The process that a `LiveTracker` starts: it reads a camera, tracks the newest frame, and writes what it saw."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from ..records.errors import LiveHandError
from .video import DecodedFrame, Video, open_camera, open_video

_SHOWN_PX = 320  # the picture's longer side as it is sent
_SILENCE_S = 10.0  # after which a camera that sends nothing is lost
_SEARCH_EVERY = 30  # frames, about a second, while a hand is followed and another may come
_ONE_THREAD = 1  # a second one waits for the first wherever cores are busy


class _Taken(NamedTuple):
    number: int
    taken_s: float
    frame: DecodedFrame


class _NewestFrame:
    """What a thread has read of the camera last. A file is played by its times, and waits for the first to be taken."""

    def __init__(self, video: Video):
        self._video, self._arrived = video, threading.Condition()
        self._taken: _Taken | None = None
        self._end: LiveHandError | str | None = None
        self._wanted = threading.Event()
        threading.Thread(target=self._read, name="livehand reader", daemon=True).start()

    def frames(self) -> Iterator[_Taken]:
        """Yield the newest frame, whenever it is asked for.

        Raises:
            LiveHandError: the camera was lost.
        """
        while True:
            self._wanted.set()
            with self._arrived:
                if not self._arrived.wait_for(lambda: self._taken or self._end, _SILENCE_S):
                    raise LiveHandError(f"{self._video.path} must send pictures, got none in {_SILENCE_S:.0f} s")
                taken, self._taken = self._taken, None
            if taken is not None:
                yield taken
            elif isinstance(self._end, LiveHandError):
                raise self._end
            else:
                return

    def _read(self) -> None:
        end: LiveHandError | str = "end"
        try:
            self._wanted.wait()
            self._play()
        except Exception as error:
            end = error if isinstance(error, LiveHandError) else LiveHandError(f"{self._video.path}: {error}")
        if self._video.device is not None and not isinstance(end, LiveHandError):
            end = LiveHandError(f"{self._video.path} must send pictures, it stopped; plug the camera in again")
        with self._arrived:
            self._end = end
            self._arrived.notify()

    def _play(self) -> None:
        began_s = None
        for number, frame in enumerate(self._video.decoded()):
            now_s = time.monotonic()
            began_s = now_s - frame.time_s if began_s is None else began_s
            if self._video.device is None:
                time.sleep(max(began_s + frame.time_s - now_s, 0.0))
            with self._arrived:
                self._taken = _Taken(number, time.monotonic(), frame)
                self._arrived.notify()


def run() -> None:
    """Run the process, from its arguments to its end."""
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no message
    threading.Thread(target=_end_with_parent, name="livehand parent", daemon=True).start()
    try:
        _track(json.loads(sys.argv[2]), pipe)
        _write(pipe, {"end": True})
    except LiveHandError as error:
        _write(pipe, {"error": str(error)})
    except BrokenPipeError:
        pass
    os._exit(0)  # a thread may wait for the camera for ever


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os._exit(0)


def _track(order: dict[str, Any], pipe: IO[bytes]) -> None:
    video = open_video(Path(order["name"])) if order["is_file"] else open_camera(order["name"])
    import torch

    from .tracker import HandTracker
    from .weights import load_networks

    torch.set_num_threads(_ONE_THREAD)
    networks = load_networks(order["weights"] and Path(order["weights"]))
    tracker = HandTracker(networks, order["hands"], _SEARCH_EVERY)
    tracker.warm_up()
    for number, taken_s, frame in _NewestFrame(video).frames():
        picture = frame.picture()
        hands = [
            {
                "track": hand.track,
                "px": hand.px.tolist(),
                "world": hand.world.tolist(),
                "presence": hand.presence,
                "right": hand.right,
            }
            for hand in tracker.track(picture)
        ]
        shown = _small(picture)
        message = {
            "index": number,
            "time_s": frame.time_s,
            "taken_s": taken_s,
            "size_px": (picture.shape[1], picture.shape[0]),
            "shape": shown.shape[:2],
            "hands": hands,
        }
        _write(pipe, message, shown.tobytes())


def _small(picture: np.ndarray) -> np.ndarray:
    """Take every n-th pixel, at most `_SHOWN_PX` a side."""
    step = -(-max(picture.shape[:2]) // _SHOWN_PX)
    return np.ascontiguousarray(picture[::step, ::step])


def _write(pipe: IO[bytes], message: dict[str, Any], more: bytes = b"") -> None:
    pipe.write(json.dumps(message).encode() + b"\n" + more)
    pipe.flush()
