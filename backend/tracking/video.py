"""Frames of a video file by PyAV: upright, in sRGB, each with its true time.

PyAV is the extra `video`. Only containers of films are opened, and only as files: FFmpeg would take text for a
terminal's recording, and follow a playlist's addresses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..records.errors import LiveHandError
from ..system.camera_device import CameraDevice, camera_device
from ..system.command import warn
from ..system.regular_file import check_regular
from .film_clock import FilmClock
from .tone_mapping import HLG, PQ, tone_mapped

if TYPE_CHECKING:
    import av
    import av.container

INSTALL_VIDEO = 'pip install "livehand[video]"'
_CONTAINERS = "mov,mp4,m4a,3gp,matroska,webm,avi,mpegts,mpeg,asf,ogg,flv,mxf,gif"
_DEFAULT_FPS, _FPS_RANGE = 30.0, (0.1, 1000.0)
_LEAST_SHARE, _MOST_NOMINAL_FPS = 0.1, 240.0  # a mean rate below that share of the nominal one is no rate
_DOUBTFUL_COUNT = 100_000  # an estimate of so many frames may come from a jump of the clock, so they are counted
_MOST_SIDE_PX = 8192
_QUARTER_DEG = 90


class VideoFrame(NamedTuple):
    """One frame: its time, s from the first, and its picture, uint8 [H, W, 3]."""

    time_s: float
    picture: np.ndarray


class DecodedFrame(NamedTuple):
    """One frame as FFmpeg decoded it: its time, s from the first, and FFmpeg's frame."""

    time_s: float
    decoded: Any

    def picture(self) -> np.ndarray:
        """uint8 [H, W, 3], upright, sRGB. Raises LiveHandError if it is too large."""
        return _upright(self.decoded)


@dataclass(frozen=True)
class Video:
    """What a video file, or a camera, says of itself; `frames` decodes it.

    Attributes:
        path: the file, or the camera's name.
        fps: mean frames per second.
        count: frames, estimated where the file does not say; 0 if unknown.
        device: the camera; None: a file.
    """

    path: Path
    fps: float
    count: int
    device: CameraDevice | None = None

    def frames(self) -> Iterator[VideoFrame]:
        """The frames in order. Where the file breaks off, they end with a warning.

        Raises:
            LiveHandError: there is no frame at all, or one is too large.
        """
        for time_s, picture in self._decoded(_upright):
            yield VideoFrame(time_s, picture)

    def decoded(self) -> Iterator[DecodedFrame]:
        """The same frames before they become pictures, so that some can be left out. Raises as `frames`."""
        for time_s, frame in self._decoded(lambda frame: frame):
            yield DecodedFrame(time_s, frame)

    def _decoded(self, converted: Callable[[Any], Any]) -> Iterator[tuple[float, Any]]:
        error_types, got = _errors(), 0
        clock = FilmClock(self.fps, has_jumps=self.device is None)
        with _opened(self.path, self.device) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            try:
                for frame in container.decode(stream):
                    had_jumps = clock.jumps
                    time_s = clock.time_s(frame.time)
                    if clock.jumps > had_jumps == 0:
                        jump = f"jumps by {clock.jump_s:.0f} s after frame {got}"
                        warn(f"{self.path}: its clock {jump}; each jump counts as one frame")
                    got += 1
                    yield time_s, converted(frame)
            except error_types as error:
                if not got:
                    raise LiveHandError(f"{self.path} must hold frames, got none ({error}); copy it again") from error
                warn(f"{self.path}: the file breaks off after frame {got} ({error}); what came before is used")
        if not got:
            raise LiveHandError(f"{self.path} must hold frames, got none; copy it again")


def open_video(path: Path) -> Video:
    """A video file.

    Raises:
        LiveHandError: PyAV is missing, or the file is no video.
    """
    check_regular(path)
    with _opened(path) as container:
        stream = container.streams.video[0]
        fps = _rate(stream)
        seconds = float(stream.duration * stream.time_base) if stream.duration and stream.time_base else 0.0
        if not seconds and container.duration:
            seconds = container.duration / 1e6
        is_counted = bool(stream.frames)
        count = int(stream.frames or round(seconds * fps))
    is_doubtful = not is_counted and count > _DOUBTFUL_COUNT
    return Video(path, fps, _count_frames(path) if is_doubtful else count)


def open_camera(name: str) -> Video:
    """A camera of this computer by its number or name.

    Raises:
        LiveHandError: PyAV is missing, or there is no such camera.
    """
    device = camera_device(name)
    with _opened(Path(name), device) as container:
        stream = container.streams.video[0]
        return Video(Path(name), _rate(stream), 0, device)


def _opened(path: Path, device: CameraDevice | None = None) -> av.container.InputContainer:
    av = import_av()
    options = {"format_whitelist": _CONTAINERS, "protocol_whitelist": "file"}
    try:
        if device is not None:
            try:
                return av.open(device.url, format=device.format)
            except (av.error.FFmpegError, OSError, ValueError) as error:
                raise LiveHandError(
                    f"{path} must be a camera that no other program uses, got {type(error).__name__} ({error}); "
                    "plug it in, or choose another number"
                ) from error
        container = av.open(str(path), options=options)
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise LiveHandError(f"{path} must be a video, got {type(error).__name__} ({error}); record it again") from error
    if not container.streams.video:
        container.close()
        raise LiveHandError(f"{path} must hold a video, got sound only; choose another file")
    return container


def import_av() -> Any:
    """PyAV's module.

    Raises:
        LiveHandError: it is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise LiveHandError(f"videos need PyAV, which is missing ({error}); install it: {INSTALL_VIDEO}") from error
    return av


def _errors() -> tuple[type[Exception], ...]:
    return (import_av().error.FFmpegError,)


def _rate(stream: Any) -> float:
    """Frames per second: the mean, unless jumps of the clock have spoilt it, or nothing is known."""
    mean, nominal = float(stream.average_rate or 0), float(stream.guessed_rate or 0)
    is_spoilt = mean < _LEAST_SHARE * nominal and nominal <= _MOST_NOMINAL_FPS
    rate = nominal if is_spoilt else mean or nominal
    return rate if _FPS_RANGE[0] <= rate <= _FPS_RANGE[1] else _DEFAULT_FPS


def _count_frames(path: Path) -> int:
    """Of a file, without decoding them."""
    with _opened(path) as container:
        try:
            return sum(packet.size > 0 for packet in container.demux(container.streams.video[0]))
        except _errors():
            return 0


def _upright(frame: Any) -> np.ndarray:
    if max(frame.width, frame.height) > _MOST_SIDE_PX:
        raise LiveHandError(f"a video must be at most {_MOST_SIDE_PX} px a side, got {frame.width}x{frame.height}")
    transfer = int(frame.color_trc or 0)
    if transfer in (HLG, PQ):
        picture = tone_mapped(frame.to_ndarray(format="rgb48le"), transfer)
    else:
        picture = frame.to_ndarray(format="rgb24")
    # FFmpeg counts anticlockwise turns that would make the picture upright, as numpy does.
    quarters = round((getattr(frame, "rotation", 0) or 0) / _QUARTER_DEG) % 4
    return np.ascontiguousarray(np.rot90(picture, quarters)) if quarters else picture
