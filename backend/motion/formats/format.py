"""The record that describes a pose file format."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..document import Document
from ..pose_file import PoseFile


class Format(NamedTuple):
    """A pose file format.

    Attributes:
        name: for people.
        matches: whether a document has this format.
        read: reads a document; raises a `LiveHandError` if it is malformed.
    """

    name: str
    matches: Callable[[Document], bool]
    read: Callable[[Document], PoseFile]
