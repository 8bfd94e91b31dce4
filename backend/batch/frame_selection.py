"""Which frames of a shot to render: lists such as `1-24,30`, and chunks for farms that split a shot into tasks."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass

_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+))?")


@dataclass(frozen=True)
class Chunk:
    """The `number`th, from 1, of `count` consecutive parts of a list, whose lengths differ by at most one."""

    number: int
    count: int

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """This part of the frames; empty if there are more parts than frames."""
        first, last = (len(frames) * number // self.count for number in (self.number - 1, self.number))
        return frames[first:last]


ALL = Chunk(1, 1)


def parse_frames(text: str) -> tuple[int, ...]:
    """`1-24,30` -> frame numbers in that order, each once.

    Raises:
        argparse.ArgumentTypeError: the text is malformed, or a range is empty.
    """
    frames: dict[int, None] = {}
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if not match:
            raise argparse.ArgumentTypeError(f"must be frames and ranges such as 1-24,30, got {text!r}")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise argparse.ArgumentTypeError(f"a range must run forwards, got {part.strip()!r}")
        frames.update(dict.fromkeys(range(first, last + 1)))
    return tuple(frames)


def parse_chunk(text: str) -> Chunk:
    """`2/8` -> the second of eight parts.

    Raises:
        argparse.ArgumentTypeError: the text is malformed, or there is no such part.
    """
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"must be I/N with I from 1 to N, such as 2/8, got {text!r}")
    return Chunk(int(number), int(count))
