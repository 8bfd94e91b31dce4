"""A frame's work as a value: renderers, and the shots they are to render. It may leave Blender's thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol

import numpy as np

from ..hand.model import HandModel
from ..records.shot import Frame, Shot

ExposureFrames = tuple[Frame, ...]
"""What one moment of a frame's exposure shows: a frame per hand, each as if alone."""


class NamedAvatar(Protocol):
    """The part of an avatar that a frame's record needs."""

    @property
    def name(self) -> str:
        """As its file says."""
        ...


class HandRenderer(Protocol):
    """The part of the backend's renderer that Blender needs."""

    @property
    def avatar(self) -> NamedAvatar:
        """The look."""
        ...

    @property
    def hand(self) -> HandModel:
        """The model of the meshes it renders."""
        ...

    def render(self, shot: Shot, should_stop: Callable[[], bool]) -> Frame:
        """One hand from one view; raises the backend's RenderStopped soon after `should_stop` says so."""
        ...


@dataclass(frozen=True)
class HandTask:
    """One hand at one moment, and what renders it. A renderer must never work on two tasks at once."""

    renderer: HandRenderer
    shot: Shot

    def run(self, should_stop: Callable[[], bool]) -> Frame:
        """Render it; raises what the renderer raises."""
        return self.renderer.render(self.shot, should_stop)

    def is_same_as(self, other: HandTask) -> bool:
        """Whether both give the same frame: one renderer, and shots that are equal to the last bit."""
        return self.renderer is other.renderer and is_equal(self.shot, other.shot)


@dataclass(frozen=True)
class FrameTask:
    """Every hand at every moment of one frame: a sharp frame has one moment, a blurred one several."""

    moments: tuple[tuple[HandTask, ...], ...]

    def run(self, should_stop: Callable[[], bool]) -> tuple[ExposureFrames, ...]:
        """Render all of it; raises what a renderer raises."""
        return tuple(tuple(task.run(should_stop) for task in tasks) for tasks in self.moments)

    def is_same_as(self, other: FrameTask) -> bool:
        """Whether both give the same frames."""
        ours, theirs = ([task for tasks in one.moments for task in tasks] for one in (self, other))
        is_alike = [len(tasks) for tasks in self.moments] == [len(tasks) for tasks in other.moments]
        return is_alike and all(one.is_same_as(another) for one, another in zip(ours, theirs, strict=True))


def is_equal(one: Any, other: Any) -> bool:
    """Equality of records of arrays, and tuples of such, by field; a dataclass's own `==` cannot compare arrays."""
    if isinstance(one, tuple):
        return len(one) == len(other) and all(is_equal(*pair) for pair in zip(one, other, strict=True))
    if is_dataclass(one):
        return type(one) is type(other) and all(
            is_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one)
        )
    return np.array_equal(one, other)
