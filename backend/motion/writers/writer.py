"""The record that describes a format that motions are written in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...records.side import Side
from ..mano_basis import ManoBasis
from .take import Take


@dataclass(frozen=True)
class WriteOptions:
    """What a user may choose.

    Attributes:
        counts_from_mean: MANO only: finger angles count from MANO's mean pose; False: they are absolute.
        basis: MANO's mean pose, where angles count from it.
        avatars: FBX, glTF and USD only: whose skin the mesh of each side wears; a side that is not there: a plain one.
        texture_px: of the skin's textures.
    """

    counts_from_mean: bool = False
    basis: ManoBasis | None = None
    avatars: Mapping[Side, Path] = field(default_factory=dict)
    texture_px: int = 2048


@dataclass(frozen=True)
class Writer:
    """A format.

    Attributes:
        name: as the user types it.
        title: for people.
        suffixes: of its files; the first is the usual one.
        write: writes a take to a path, atomically, and returns what the file cannot hold, in words; raises a
            `LiveHandError` if the take or the options do not fit the format.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Take, Path, WriteOptions], tuple[str, ...]]
