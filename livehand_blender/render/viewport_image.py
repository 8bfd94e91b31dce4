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
