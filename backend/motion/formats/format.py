"""What a format is: a name, how its files are known, and how they are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..document import Document
from ..pose_file import PoseFile


class Format(NamedTuple):
    """One way of keeping poses.

    Attributes:
        name: for people.
        is_like: whether a document looks like one of these.
        read: a document's hands; raises a `LiveHandError` where it is malformed.
    """

    name: str
    is_like: Callable[[Document], bool]
    read: Callable[[Document], PoseFile]
