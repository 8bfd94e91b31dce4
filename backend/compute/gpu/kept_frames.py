"""What renders frames of any shape: it keeps the buffers, and the recorded sequences, of the last few."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar, runtime_checkable

Shot = TypeVar("Shot", contravariant=True)
Pixels = TypeVar("Pixels", covariant=True)
Given = TypeVar("Given")
Shape = TypeVar("Shape")
Found = TypeVar("Found")

_MOST_KEPT = 4
_NO_MEMORY = "Failed to allocate"  # as Warp says it


@runtime_checkable
class ShapedFrame(Protocol[Shot, Pixels]):
    """Renders frames of one shape."""

    def render(self, shot: Shot) -> Pixels | None:
        """Render a frame, whose pixels are valid until the next; None: a list has overflowed."""
        ...


class KeptFrames(Generic[Given, Shape, Found]):
    """Renders frames of a model in any shape, one at a time."""

    def __init__(self, shape_of: Callable[[Given], Shape], make: Callable[[Shape], ShapedFrame[Given, Found]]) -> None:
        self._shape_of, self._make = shape_of, make
        self._kept = OrderedDict[Shape, ShapedFrame[Given, Found]]()

    def render(self, shot: Given) -> Found | None:
        """Render a frame, as `ShapedFrame`; None where the device's memory is too full as well."""
        try:
            frame = self.of(self._shape_of(shot))
        except RuntimeError as error:
            if _NO_MEMORY not in str(error):
                raise
            self._kept.clear()
            return None
        return frame.render(shot)

    def of(self, shape: Shape) -> ShapedFrame[Given, Found]:
        """Return the frames of a shape."""
        if shape not in self._kept:
            while len(self._kept) >= _MOST_KEPT:
                self._kept.popitem(last=False)
            self._kept[shape] = self._make(shape)
        self._kept.move_to_end(shape)
        return self._kept[shape]
