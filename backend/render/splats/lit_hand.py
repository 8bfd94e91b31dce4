"""What splats are made of: hands in frames with their renderers, and what a user may choose. It needs no torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ...avatars.origin import Origin
from ...image.grade import Grade
from ...records.errors import LiveHandError
from ...records.shot import Shot
from ..frame_task import HandRenderer

_COUNT, _VIEWS, _SIZE_PX = (1000, 500_000), (12, 400), (128, 2048)


@dataclass(frozen=True)
class SplatOptions:
    """What a user may choose.

    Attributes:
        count: about how many splats a hand gets.
        views: that they are fitted to.
        size_px: width and height of a view.

    Raises:
        LiveHandError: one is out of its range.
    """

    count: int = 50_000
    views: int = 48
    size_px: int = 512

    def __post_init__(self):
        for name, (least, most) in (("count", _COUNT), ("views", _VIEWS), ("size_px", _SIZE_PX)):
            if not least <= getattr(self, name) <= most:
                raise LiveHandError(f"splats' {name} must lie in {least} to {most}, got {getattr(self, name)}")


class LitHand(NamedTuple):
    """A hand in a frame.

    Attributes:
        renderer: of its avatar.
        shot: of any camera.
        origin: of its avatar.
        grade: of its colours.
        name: the same in all frames, and no other hand's.
    """

    renderer: HandRenderer
    shot: Shot
    origin: Origin
    grade: Grade
    name: str
