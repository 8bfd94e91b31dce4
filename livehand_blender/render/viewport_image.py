"""Renders the image of hands that is drawn over a 3D view, in the preview's thread and without bpy."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import numpy as np

from ...backend.image.grade import graded
from ...backend.records.camera import Camera
from ...backend.records.frame import Frame
from ...backend.records.shot import Quality
from ...backend.render.composition import joined, visible_parts
from ...backend.render.session import Session
from ...backend.system.thread_limits import thread_limit
from ..light.foreground import foreground_triangles
from ..light.solids import Solid
from .viewport_hand import ViewportHand

# Cycles keeps every core busy meanwhile, and torch's threads wait for one another after every operation: on two busy
# cores an image takes twice as long with two threads as with one.
_THREADS = max(1, (os.cpu_count() or 1) // 4)

_SIDES_PX = (128, 160, 192, 224, 256, 320, 384, 448, 512)
_FIRST_PX = 256
_WANTED_S = 1 / 24
# A choice is made from several pictures: one alone may have waited for an avatar, a kernel or another program.
_FEWEST, _MOST = 3, 5
# A larger picture is tried only if it would take this share of the wanted time, so that sizes do not flicker.
_SPARE = 0.8


class ViewportImage(NamedTuple):
    """An image that is drawn over a view.

    Attributes:
        rgba: [h, w, 4] float32, bottom row first, in the scene's working space, premultiplied.
        box: its left, top, right and bottom edges in the view's rectangle, px from the upper left.
        is_at_once: whether it is final, and its hands' frames were rendered at once.
    """

    rgba: np.ndarray
    box: tuple[float, float, float, float]
    is_at_once: bool = False


@dataclass(frozen=True)
class ViewportRequest:
    """What to render for a view.

    Attributes:
        hands: that the view shows.
        camera: of the view at full size.
        to_working_space: [3, 3], from linear Rec.709 (`rec709_to_working_space`).
        foreground: objects of the scene that may hide the hands.
    """

    hands: tuple[ViewportHand, ...]
    camera: Camera
    to_working_space: np.ndarray
    foreground: tuple[Solid, ...] = ()

    def render(
        self,
        session: Session,
        scale: float,
        should_stop: Callable[[], bool],
        quality: Quality = "final",
        scale_at_once: float | None = None,
    ) -> ViewportImage | None:
        """Render the image; None if no hand is in view.

        Args:
            session: of the avatars.
            scale: of the image, times the view's resolution.
            should_stop: as `Renderer.render` takes it.
            quality: as in `Shot`: penumbras of a preview have no steps, those of a final image fine ones.
            scale_at_once: of a final image in its place, if all hands' frames are rendered at once; None: never.

        Raises:
            LiveHandError: a hand cannot be rendered.
        """
        with session.rendering:
            is_at_once = all(hand.renderer(session).renders_at_once for hand in self.hands)
            if scale_at_once is not None and is_at_once:
                scale, quality = scale_at_once, "final"
            camera = self.camera.scaled(scale)
            tasks = [hand.task(session, camera, quality) for hand in self.hands]
            with thread_limit(_THREADS):
                frames = [task.run(should_stop) for task in tasks]
        if not frames:
            return None
        graded_frames = [graded(frame, hand.grade) for frame, hand in zip(frames, self.hands, strict=True)]
        from ...backend.render.surface_maps import scene_depth  # torch, which a renderer has imported already

        triangles = foreground_triangles(self.foreground, camera, [hand.vertices for hand in self.hands])
        depth = scene_depth(triangles, camera) if len(triangles) else None
        image = viewport_image(joined(visible_parts(graded_frames, depth)), scale, self.to_working_space)
        return None if image is None else image._replace(is_at_once=is_at_once and quality == "final")


def viewport_image(frame: Frame, scale: float, to_working_space: np.ndarray) -> ViewportImage | None:
    """Crop a frame of `scale` times a view's resolution to the hands in it; None if it is empty."""
    rows, columns = (np.flatnonzero(frame.alpha.any(axis)) for axis in (1, 0))
    if not len(rows):
        return None
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    rgb = frame.rgb[top:bottom, left:right] @ to_working_space.T
    rgba = np.concatenate([rgb, frame.alpha[top:bottom, left:right, None]], -1)
    box = (left / scale, top / scale, right / scale, bottom / scale)
    return ViewportImage(np.ascontiguousarray(rgba[::-1], np.float32), box)


@dataclass(frozen=True)
class ViewportStep:
    """A step that the preview's thread runs.

    Attributes:
        request: what to render.
        session: of the avatars.
        scale: of the image, times the view's resolution.
        moving_px: the longer side that the view's pace chose for an image of what moves, of which the scale came; None:
            the image is of what rests, with fine penumbras.
        scale_at_once: of an image of what moves, where it is rendered as one that rests; None: it is not.
    """

    request: ViewportRequest
    session: Session
    scale: float
    moving_px: int | None = None
    scale_at_once: float | None = None

    def __call__(self, should_stop: Callable[[], bool]) -> ViewportImage | None:
        """Render the image, as `ViewportRequest.render`."""
        quality: Quality = "final" if self.moving_px is None else "preview"
        return self.request.render(self.session, self.scale, should_stop, quality, self.scale_at_once)


class Pace:
    """Chooses the longer side of moving pictures by the time that the last ones took.

    Time is taken to grow with the number of pixels. It grows less, so a smaller picture may have to be made smaller
    once more, and a larger one is never too slow for that reason.
    """

    def __init__(self, wanted_s: float = _WANTED_S):
        self._wanted_s = wanted_s
        self._side_px = _FIRST_PX
        self._seconds: deque[float] = deque(maxlen=_MOST)
        self._seconds_whole: deque[float] = deque(maxlen=_MOST)

    @property
    def keeps_whole(self) -> bool:
        """Whether pictures of the full size that are rendered at once have taken no longer than wanted."""
        return len(self._seconds_whole) < _FEWEST or median(self._seconds_whole) <= self._wanted_s

    @property
    def side_px(self) -> int:
        """The longer side of the next picture."""
        return self._side_px

    def record_whole(self, seconds: float) -> None:
        """Take note of the time of a picture of the full size that was rendered at once."""
        self._seconds_whole.append(seconds)

    def record(self, side_px: int, seconds: float) -> None:
        """Take note of the time of a picture of this longer side; one of an earlier choice does not count."""
        if side_px != self._side_px:
            return
        self._seconds.append(seconds)
        if len(self._seconds) < _FEWEST:
            return
        seconds = median(self._seconds)
        side_px = self._affordable_px(seconds)
        if side_px > self._side_px or (seconds > self._wanted_s and side_px < self._side_px):
            self._side_px = side_px
            self._seconds.clear()

    def _affordable_px(self, seconds: float) -> int:
        """Compute the largest side with time to spare, if a picture of the present side takes so long."""
        per_pixel_s = seconds / self._side_px**2
        return max(
            (side for side in _SIDES_PX if per_pixel_s * side**2 <= _SPARE * self._wanted_s), default=_SIDES_PX[0]
        )
