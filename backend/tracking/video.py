"""Frames of a video file by PyAV: upright, in sRGB, each with its true time.

ITU-R BT.2100: hybrid log-gamma (HLG) and the perceptual quantiser (PQ), both on BT.2020 primaries. White at 203 cd/m^2
(BT.2408) becomes 1 before the shoulder.

PyAV is the extra `video`. Only containers of films are opened, and only as files: FFmpeg would take text for a
terminal's recording, and follow a playlist's addresses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..records.errors import LiveHandError
from ..system.camera_device import CameraDevice, camera_device
from ..system.command import warn
from ..system.files import check_regular

if TYPE_CHECKING:
    import av
    import av.container


HLG, PQ = 18, 16
"""Numbers of the transfer functions (ITU-T H.273)."""

_HLG_A, _HLG_B, _HLG_C = 0.17883277, 0.28466892, 0.55991073
_HLG_SYSTEM_GAMMA, _HLG_PEAK_CD = 1.2, 1000.0
_PQ_M1, _PQ_M2, _PQ_C1, _PQ_C2, _PQ_C3, _PQ_PEAK_CD = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875, 10000.0
_WHITE_CD = 203.0
_LUMINANCE_2020 = np.array([0.2627, 0.6780, 0.0593], np.float32)
_TO_709 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]], np.float32)
_SHOULDER = 0.8  # of white; brighter light is compressed
_LEVELS = 1 << 12  # of the tables


def tone_mapped(encoded: np.ndarray, transfer: int) -> np.ndarray:
    """Tone-map a picture uint16 [H, W, 3] in HLG or PQ to uint8 [H, W, 3] sRGB."""
    linear = _table(transfer)[encoded >> 4]
    if transfer == HLG:
        scene_luminance = linear @ _LUMINANCE_2020
        gain = np.maximum(scene_luminance, 1e-6) ** np.float32(_HLG_SYSTEM_GAMMA - 1)
        linear = linear * (gain * np.float32(_HLG_PEAK_CD / _WHITE_CD))[..., None]
    shown = _rolled_off(np.maximum(linear @ _TO_709.T, 0))
    return _srgb_table()[(shown * (_LEVELS - 1) + 0.5).astype(np.int32)]


def _rolled_off(linear: np.ndarray) -> np.ndarray:
    """Keep values as they are up to the shoulder, then roll off towards 1."""
    over = np.maximum(linear - _SHOULDER, 0) / (1 - _SHOULDER)
    return np.where(linear <= _SHOULDER, linear, _SHOULDER + (1 - _SHOULDER) * over / (1 + over)).astype(np.float32)


@cache
def _table(transfer: int) -> np.ndarray:
    """Tabulate the linear light [4096] of 12 bits: HLG's scene light in 0..1, PQ's in units of white."""
    encoded = np.arange(_LEVELS) / (_LEVELS - 1)
    if transfer == HLG:
        high = (np.exp((encoded - _HLG_C) / _HLG_A) + _HLG_B) / 12
        return np.where(encoded <= 0.5, encoded**2 / 3, high).astype(np.float32)
    power = encoded ** (1 / _PQ_M2)
    linear = (np.maximum(power - _PQ_C1, 0) / (_PQ_C2 - _PQ_C3 * power)) ** (1 / _PQ_M1)
    return (linear * _PQ_PEAK_CD / _WHITE_CD).astype(np.float32)


@cache
def _srgb_table() -> np.ndarray:
    linear = np.arange(_LEVELS) / (_LEVELS - 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (encoded * 255).round().astype(np.uint8)


INSTALL_VIDEO = 'pip install "livehand[video]"'
_CONTAINERS = "mov,mp4,m4a,3gp,matroska,webm,avi,mpegts,mpeg,asf,ogg,flv,mxf,gif"
_DEFAULT_FPS, _FPS_RANGE = 30.0, (0.1, 1000.0)
_MOST_FPS = 250.0  # of cameras that film hands
_LEAST_SHARE, _MOST_NOMINAL_FPS = 0.1, 240.0  # a mean rate below that share of the nominal one is no rate
_DOUBTFUL_COUNT = 100_000  # an estimate of so many frames may come from a jump of the clock, so they are counted
_MOST_SIDE_PX = 8192
_QUARTER_DEG = 90
_EARLY = 0.25  # of a step, by which a frame may come before its time


class VideoFrame(NamedTuple):
    """One frame: its time, s from the first, and its picture, uint8 [H, W, 3]."""

    time_s: float
    picture: np.ndarray


class DecodedFrame(NamedTuple):
    """One frame as FFmpeg decoded it: its time, s from the first, and FFmpeg's frame."""

    time_s: float
    decoded: Any

    def picture(self) -> np.ndarray:
        """Convert to uint8 [H, W, 3], upright, sRGB. Raises LiveHandError if it is too large."""
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
        """Yield the frames in order. Where the file breaks off, they end with a warning.

        Raises:
            LiveHandError: there is no frame at all, or one is too large.
        """
        for time_s, picture in self._decoded(_upright):
            yield VideoFrame(time_s, picture)

    def thinned(self, most_fps: float) -> Iterator[VideoFrame]:
        """Yield at most so many frames a second, evenly; the same ones each time. Raises as `frames`."""
        next_s = 0.0
        for frame in self.decoded():
            if frame.time_s >= next_s - _EARLY / most_fps:
                next_s = frame.time_s + 1 / most_fps
                yield VideoFrame(frame.time_s, frame.picture())

    def decoded(self) -> Iterator[DecodedFrame]:
        """Yield the same frames before they become pictures, so that some can be left out. Raises as `frames`."""
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
    """Open a video file.

    Raises:
        LiveHandError: PyAV is missing, or the file is no video.
    """
    check_regular(path)
    with _opened(path) as container:
        stream = container.streams.video[0]
        fps = _rate(stream)
        if (mean := float(stream.average_rate or 0)) > _MOST_FPS:
            warn(
                f"{path}: its time stamps give {mean:.4g} frames a second and are probably broken: speeds and blur "
                "will be wrong; write it anew with its true rate (ffmpeg -r 30 -i ...)"
            )
        seconds = float(stream.duration * stream.time_base) if stream.duration and stream.time_base else 0.0
        if not seconds and container.duration:
            seconds = container.duration / 1e6
        is_counted = bool(stream.frames)
        count = int(stream.frames or round(seconds * fps))
    is_doubtful = not is_counted and count > _DOUBTFUL_COUNT
    return Video(path, fps, _count_frames(path) if is_doubtful else count)


def open_camera(name: str) -> Video:
    """Open a camera of this computer by its number or name.

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
    """Import PyAV.

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
    """Compute frames per second: the mean, unless jumps of the clock have spoilt it, or nothing is known."""
    mean, nominal = float(stream.average_rate or 0), float(stream.guessed_rate or 0)
    is_spoilt = mean < _LEAST_SHARE * nominal and nominal <= _MOST_NOMINAL_FPS
    rate = nominal if is_spoilt else mean or nominal
    return rate if _FPS_RANGE[0] <= rate <= _FPS_RANGE[1] else _DEFAULT_FPS


def _count_frames(path: Path) -> int:
    """Count the frames of a file, without decoding them."""
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


LONGEST_STEP_S = 5.0
"""From a frame to the next; a longer one, or one so far back, is the clock's jump and counts as one frame."""


class FilmClock:
    """Turns the times that a file gives its frames into increasing ones from 0.

    A file's clock may jump, as an MPEG transport stream's does every 26.5 hours.

    Args:
        fps: of the film; for frames without a time, and the length of a jump.
        has_jumps: whether long steps are jumps; a camera may really pause.

    Attributes:
        jumps: how many there were.
        jump_s: the first one's length, s.
    """

    def __init__(self, fps: float, has_jumps: bool = True):
        self.jumps, self.jump_s = 0, 0.0
        self._frame_s, self._has_jumps = 1 / fps, has_jumps
        self._count, self._last = 0, -1.0
        self._start: float | None = None
        self._given = 0.0

    def time_s(self, given_s: float | None) -> float:
        """Return the time of the next frame, s; None: the file gives it none."""
        if given_s is None:
            given_s = (self._start or 0.0) + self._count * self._frame_s
        if self._start is None:
            self._start = self._given = given_s
        step = given_s - self._given
        if self._has_jumps and abs(step) > LONGEST_STEP_S:
            self.jumps, self.jump_s = self.jumps + 1, self.jump_s or step
            self._start += step - self._frame_s
        time_s = given_s - self._start
        if time_s <= self._last:  # a time that repeats or goes back
            time_s = self._last + self._frame_s
        self._given, self._last, self._count = given_s, time_s, self._count + 1
        return time_s
