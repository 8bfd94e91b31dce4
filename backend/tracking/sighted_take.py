"""What the tracker saw in a video, as a take."""

from __future__ import annotations

from math import radians, tan
from pathlib import Path
from typing import TYPE_CHECKING

from ..motion.landmarks.take_file import FilmedTake
from ..motion.landmarks.take_fit import FilmCamera, FilmedHand
from ..records.errors import LiveHandError
from ..records.side import Side

if TYPE_CHECKING:
    from .takes import VideoSightings


def filmed_take(found: VideoSightings, fps: float, fov_deg: float | None, path: Path) -> FilmedTake:
    """What was tracked as a take.

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
