"""Renders the image of hands that is drawn over a 3D view, in the preview's thread and without bpy."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
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


class ViewportImage(NamedTuple):
    """An image that is drawn over a view.

    Attributes:
        rgba: [h, w, 4] float32, bottom row first, in the scene's working space, premultiplied.
        box: its left, top, right and bottom edges in the view's rectangle, px from the upper left.
    """

    rgba: np.ndarray
    box: tuple[float, float, float, float]


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
        self, session: Session, scale: float, should_stop: Callable[[], bool], quality: Quality = "final"
    ) -> ViewportImage | None:
        """Render the image at `scale` times the view's resolution; None if no hand is in view.

        `quality` as in `Shot`: penumbras of a preview have no steps, those of a final image fine ones.

        Raises:
            LiveHandError: a hand cannot be rendered.
        """
        camera = self.camera.scaled(scale)
        with session.rendering:
            tasks = [hand.task(session, camera, quality) for hand in self.hands]
            with thread_limit(_THREADS):
                frames = [task.run(should_stop) for task in tasks]
        if not frames:
            return None
        graded_frames = [graded(frame, hand.grade) for frame, hand in zip(frames, self.hands, strict=True)]
        from ...backend.render.surface_maps import scene_depth  # torch, which a renderer has imported already

        triangles = foreground_triangles(self.foreground, camera, [hand.vertices for hand in self.hands])
        depth = scene_depth(triangles, camera) if len(triangles) else None
        return viewport_image(joined(visible_parts(graded_frames, depth)), scale, self.to_working_space)


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
    """

    request: ViewportRequest
    session: Session
    scale: float
    moving_px: int | None = None

    def __call__(self, should_stop: Callable[[], bool]) -> ViewportImage | None:
        """Render the image, as `ViewportRequest.render`."""
        return self.request.render(
            self.session, self.scale, should_stop, "final" if self.moving_px is None else "preview"
        )
