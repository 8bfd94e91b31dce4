"""What the tracker saw in a video, as a take."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians, tan
from pathlib import Path
from typing import TYPE_CHECKING

from ..motion.landmarks.take_file import FilmedTake
from ..motion.landmarks.take_fit import FilmCamera, FilmedHand
from ..motion.motion import MOST_FRAMES
from ..records.errors import LiveHandError
from ..records.side import Side
from ..system.command import warn

if TYPE_CHECKING:
    from .takes import VideoSightings
    from .video import Video, VideoFrame


def frames_of_film(video: Video, most_fps: float | None = None) -> Iterator[VideoFrame]:
    """Yield the frames of a film of bounded length; where it turns out longer than it said, they end with a warning.

    Args:
        video: the film.
        most_fps: frames a second; None: all.

    Raises:
        LiveHandError: it says that it is longer; before the first frame.
    """
    if video.count > MOST_FRAMES:
        raise LiveHandError(
            f"{video.path} must have at most {MOST_FRAMES} frames, got {video.count}; cut it into parts"
        )
    return _bounded(video, video.frames() if most_fps is None else video.thinned(most_fps))


def _bounded(video: Video, frames: Iterator[VideoFrame]) -> Iterator[VideoFrame]:
    for index, frame in enumerate(frames):
        if max(index, frame.time_s * video.fps) >= MOST_FRAMES:
            warn(f"{video.path}: a take lasts at most {MOST_FRAMES} frames; those after frame {index} are left out")
            return
        yield frame


def filmed_take(found: VideoSightings, fps: float, fov_deg: float | None, path: Path) -> FilmedTake:
    """Return what was tracked as a take.

    Raises:
        LiveHandError: no hand was found.
    """
    if not found.hands:
        raise LiveHandError(
            f"{path} must show a hand, got none in {len(found.times)} frames; film the whole hand, larger and in light"
        )
    camera = FilmCamera.guessed(found.size_px)
    if fov_deg is not None:
        camera = FilmCamera(found.size_px, found.size_px[0] / 2 / tan(radians(fov_deg) / 2))
    hands: dict[Side, FilmedHand] = {}
    for side, hand in found.hands.items():
        hands[side] = FilmedHand(hand.frames, hand.px, hand.world)
    return FilmedTake(camera, found.times, fps, hands)
