"""Hands and a camera -> the picture that is laid over a 3D view. Runs in the preview's thread, without bpy."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....backend.avatars.session import Session
from ....backend.records.camera import Camera
from ....backend.records.shot import Frame
from ....backend.rendering.composition import joined, visible_parts
from ....backend.runtime.thread_limits import thread_limit
from ...scene.grade import graded
from .subject import ViewportHand

# Cycles keeps every core busy meanwhile, and torch's threads wait for one another after every operation: on two busy
# cores a picture takes twice as long with two threads as with one.
_THREADS = max(1, (os.cpu_count() or 1) // 4)


class ViewportImage(NamedTuple):
    """What is drawn over a view.

    Attributes:
        rgba: [h, w, 4] float32, bottom row first, in the scene's working space, premultiplied.
        box: left, top, right, bottom of it in the view's rectangle, px from the upper left.
    """

    rgba: np.ndarray
    box: tuple[float, float, float, float]


@dataclass(frozen=True)
class ViewportRequest:
    """A picture that is asked for.

    Attributes:
        subjects: the hands in it.
        camera: of the view at full size.
        to_working_space: [3, 3], from linear Rec.709 (`rec709_to_working_space`).
    """

    subjects: tuple[ViewportHand, ...]
    camera: Camera
    to_working_space: np.ndarray

    def render(self, session: Session, scale: float, should_stop: Callable[[], bool]) -> ViewportImage | None:
        """The picture at `scale` times the view's resolution; None where no hand is in view.

        Raises:
            LiveHandError: a hand cannot be rendered.
        """
        camera = self.camera.scaled(scale)
        with session.rendering:
            tasks = [subject.task(session, camera) for subject in self.subjects]
            with thread_limit(_THREADS):
                frames = [task.run(should_stop) for task in tasks]
        if not frames:
            return None
        looks = [graded(frame, subject.grade) for frame, subject in zip(frames, self.subjects, strict=True)]
        return picture_of(joined(visible_parts(looks)), scale, self.to_working_space)


def picture_of(frame: Frame, scale: float, to_working_space: np.ndarray) -> ViewportImage | None:
    """Cut a frame of `scale` times a view's resolution to what is in it; None where nothing is."""
    rows, columns = (np.flatnonzero(frame.alpha.any(axis)) for axis in (1, 0))
    if not len(rows):
        return None
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    rgb = frame.rgb[top:bottom, left:right] @ to_working_space.T
    rgba = np.concatenate([rgb, frame.alpha[top:bottom, left:right, None]], -1)
    box = (left / scale, top / scale, right / scale, bottom / scale)
    return ViewportImage(np.ascontiguousarray(rgba[::-1], np.float32), box)
