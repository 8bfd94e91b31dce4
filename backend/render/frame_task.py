"""The rendering of a frame as a plain value, which may leave Blender's thread: renderers and the shots they render."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..hand.model import HandModel
from ..image.grade import Grade
from ..records.frame import Frame
from ..records.shot import Shot, SurfaceMesh

_PLAIN = str, int, float, bool, type(Path())

ExposureFrames = tuple[Frame, ...]
"""What one exposure sample shows: a frame per hand, each as if alone."""


@runtime_checkable
class NamedAvatar(Protocol):
    """The part of an avatar that a frame's record needs."""

    @property
    def name(self) -> str:
        """The name in its file."""
        ...

    @property
    def provenance(self) -> Mapping[str, Any]:
        """What it was made from, its licence, and what its person agreed to."""
        ...


@runtime_checkable
class HandRenderer(Protocol):
    """The part of the backend's renderer that Blender needs."""

    @property
    def avatar(self) -> NamedAvatar:
        """The avatar that it renders."""
        ...

    @property
    def hand(self) -> HandModel:
        """The hand model of the meshes that it renders."""
        ...

    @property
    def is_relightable(self) -> bool:
        """Whether its frames depend on the shot's light."""
        ...

    @property
    def mean_albedo(self) -> np.ndarray | None:
        """[3] linear diffuse reflectance of the skin; None: not known, as light is baked into its colours."""
        ...

    @property
    def frames_at_once(self) -> int:
        """How many frames of a sequence it renders in less time at once than one by one; 1: it must not."""
        ...

    @property
    def renders_at_once(self) -> bool:
        """Whether a GPU renders most of its frames as one, so that smaller ones would hardly take less time."""
        ...

    def posed_surface(self, shot: Shot) -> SurfaceMesh | None:
        """Return the avatar's surface as frames show it; None: frames show the mesh's."""
        ...

    def render(self, shot: Shot, should_stop: Callable[[], bool]) -> Frame:
        """Render one hand from one view; raises RenderStopped soon after `should_stop` returns True."""
        ...


@dataclass(frozen=True)
class HandInstance:
    """One hand in a frame.

    Attributes:
        name: of its armature, and of what makes an instance of it.
        mesh_name: of the visible object, under which Cryptomatte lists the hand.
        renderer: of its avatar.
        grade: the change of its colours.
        is_holdout: whether it leaves a hole in the picture, where it hides what is behind.
    """

    name: str
    mesh_name: str
    renderer: HandRenderer
    grade: Grade
    is_holdout: bool = False


@dataclass(frozen=True)
class HandTask:
    """One hand in one exposure sample, and its renderer."""

    renderer: HandRenderer
    shot: Shot

    def run(self, should_stop: Callable[[], bool]) -> Frame:
        """Render the hand and fade its end; raises what the renderer raises."""
        frame = self.renderer.render(self.shot, should_stop)
        if self.shot.wrist_fade_m == 0:
            return frame
        from .wrist_fade import faded  # torch, which may be missing until a hand is rendered

        return faded(frame, self.shot, self.renderer.hand)

    def is_same_as(self, other: HandTask) -> bool:
        """Return whether both give the same frame: one renderer, and shots that are equal to the last bit."""
        return self.renderer is other.renderer and is_equal(self.shot, other.shot)


@dataclass(frozen=True)
class FrameTask:
    """Every hand in every exposure sample of one frame: a sharp frame has one sample, a blurred one several."""

    samples: tuple[tuple[HandTask, ...], ...]

    @property
    def frames_at_once(self) -> int:
        """As in `HandRenderer`, of all hands."""
        return min((hand.renderer.frames_at_once for hand in chain(*self.samples)), default=1)

    def run(self, should_stop: Callable[[], bool]) -> tuple[ExposureFrames, ...]:
        """Render all hands; raises what a renderer raises."""
        return tuple(tuple(hand.run(should_stop) for hand in hands) for hands in self.samples)

    def is_same_as(self, other: FrameTask) -> bool:
        """Return whether both give the same frames."""
        pairs = zip(chain(*self.samples), chain(*other.samples), strict=False)
        has_same_shape = [len(hands) for hands in self.samples] == [len(hands) for hands in other.samples]
        return has_same_shape and all(ours.is_same_as(theirs) for ours, theirs in pairs)


def is_equal(one: Any, other: Any) -> bool:
    """Return whether records and tuples of arrays are equal by field; a dataclass's own `==` cannot compare arrays."""
    if one is other:
        return True
    if isinstance(one, tuple):
        return len(one) == len(other) and all(is_equal(*pair) for pair in zip(one, other, strict=True))
    if is_dataclass(one):
        return type(one) is type(other) and all(
            is_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one)
        )
    if type(one) in _PLAIN and type(other) in _PLAIN:  # there are many, of which numpy would make arrays
        return one == other
    return np.array_equal(one, other)
