"""A part of a list of frames, for farms that cut a shot into tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Chunk:
    """The `number`th, from 1, of `count` consecutive parts of a list that differ in length by one at most."""

    number: int
    count: int

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """This part; empty where there are more parts than frames."""
        first, last = (len(frames) * number // self.count for number in (self.number - 1, self.number))
        return frames[first:last]


ALL = Chunk(1, 1)
