"""Which frames of a shot to render: lists such as `1-24,30`, and chunks for farms that split a shot into tasks."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

LAST_FRAME = 1048574
"""Of any scene, as Blender limits it; its negative is the first."""
_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+))?")


@dataclass(frozen=True)
class Chunk:
    """The `number`th, from 1, of `count` consecutive parts of a list, whose lengths differ by at most one."""

    number: int
    count: int

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """Select this part of the frames; empty if there are more parts than frames."""
        first, last = (len(frames) * number // self.count for number in (self.number - 1, self.number))
        return frames[first:last]


ALL = Chunk(1, 1)


def parse_frames(text: str) -> Sequence[int]:
    """Parse frame numbers such as `1-24,30`, in that order, each once.

    Raises:
        argparse.ArgumentTypeError: the text is malformed, or a range is empty or beyond Blender's frames.
    """
    ranges = [_parse_range(part.strip()) for part in text.split(",")]
    return ranges[0] if len(ranges) == 1 else tuple(dict.fromkeys(chain(*ranges)))


def _parse_range(text: str) -> range:
    match = _RANGE.fullmatch(text)
    if not match:
        raise argparse.ArgumentTypeError(f"must be frames and ranges such as 1-24,30, got {text!r}")
    first, last = int(match[1]), int(match[2] or match[1])
    if last < first:
        raise argparse.ArgumentTypeError(f"a range must run forwards, got {text!r}")
    if not -LAST_FRAME <= first <= last <= LAST_FRAME:
        raise argparse.ArgumentTypeError(f"frames must lie in {-LAST_FRAME} to {LAST_FRAME}, got {text!r}")
    return range(first, last + 1)


def parse_chunk(text: str) -> Chunk:
    """Parse a part of the frames: `2/8` is the second of eight.

    Raises:
        argparse.ArgumentTypeError: the text is malformed, or there is no such part.
    """
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"must be I/N with I from 1 to N, such as 2/8, got {text!r}")
    return Chunk(int(number), int(count))
