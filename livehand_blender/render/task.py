"""One frame's work as a value: a renderer, and the shot it is to render. It may leave Blender's thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol

import numpy as np

from ...backend.shot import Frame, Shot


class HandRenderer(Protocol):
    """The part of the backend's renderer that Blender needs."""

    def render(self, shot: Shot, should_stop: Callable[[], bool]) -> Frame:
        """One hand from one view; raises the backend's RenderStopped soon after `should_stop` says so."""
        ...


@dataclass(frozen=True)
class Task:
    """What to render, and by what. A renderer must never work on two tasks at once."""

    renderer: HandRenderer
    shot: Shot

    def run(self, should_stop: Callable[[], bool]) -> Frame:
        """Render it; raises what the renderer raises."""
        return self.renderer.render(self.shot, should_stop)

    def is_same_as(self, other: Task) -> bool:
        """Whether both give the same frame: one renderer, and shots that are equal to the last bit."""
        return self.renderer is other.renderer and is_equal(self.shot, other.shot)


def is_equal(one: Any, other: Any) -> bool:
    """Equality of records of arrays, and tuples of such, by field; a dataclass's own `==` cannot compare arrays."""
    if isinstance(one, tuple):
        return len(one) == len(other) and all(is_equal(*pair) for pair in zip(one, other, strict=True))
    if is_dataclass(one):
        return type(one) is type(other) and all(
            is_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one)
        )
    return np.array_equal(one, other)
