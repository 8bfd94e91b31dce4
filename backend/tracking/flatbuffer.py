"""Reads tables, vectors and strings of a FlatBuffer, every access within the file's bounds."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from ..records.errors import LiveHandError


@dataclass(frozen=True)
class FlatTable:
    """A table of a FlatBuffer: its fields, by their number in the schema, are scalars or offsets to more.

    Attributes:
        raw: the whole file.
        start: of the table, bytes.

    Raises:
        LiveHandError: by every method: a part lies outside the file.
    """

    raw: bytes
    start: int

    @classmethod
    def root(cls, raw: bytes) -> FlatTable:
        """Return the table that the file is."""
        return cls(raw, _unpack("<I", raw, 0))

    def scalar(self, field: int, kind: str = "<i", default: int = 0) -> int:
        """Read a number in `struct`'s format; the default where the file leaves it out."""
        place = self._place(field)
        return default if place is None else _unpack(kind, self.raw, place)

    def table(self, field: int) -> FlatTable | None:
        """Return a table below this one; None if there is none."""
        place = self._place(field)
        return None if place is None else FlatTable(self.raw, place + _unpack("<I", self.raw, place))

    def tables(self, field: int) -> list[FlatTable]:
        """List a vector of tables; empty if there is none."""
        first, count = self._vector(field, 4)
        points = range(first, first + 4 * count, 4)
        return [FlatTable(self.raw, place + _unpack("<I", self.raw, place)) for place in points]

    def numbers(self, field: int, dtype: str = "<i4") -> np.ndarray:
        """Read a vector of numbers; empty if there is none."""
        kind = np.dtype(dtype)
        first, count = self._vector(field, kind.itemsize)
        return np.frombuffer(self.raw, kind, count, first) if count else np.zeros(0, kind)

    def _vector(self, field: int, item_bytes: int) -> tuple[int, int]:
        """Return the first item's position and the number of items."""
        place = self._place(field)
        if place is None:
            return 0, 0
        start = place + _unpack("<I", self.raw, place)
        count = _unpack("<I", self.raw, start)
        if start + 4 + count * item_bytes > len(self.raw):
            raise LiveHandError(f"a network's file must be whole, got {count} items beyond its end; fetch it again")
        return start + 4, count

    def _place(self, field: int) -> int | None:
        names = self.start - _unpack("<i", self.raw, self.start)
        if 4 + 2 * field >= _unpack("<H", self.raw, names):
            return None
        offset = _unpack("<H", self.raw, names + 4 + 2 * field)
        return self.start + offset if offset else None


def _unpack(kind: str, raw: bytes, place: int) -> int:
    try:
        if place < 0:
            raise struct.error("before its start")
        return struct.unpack_from(kind, raw, place)[0]
    except struct.error as error:
        raise LiveHandError(f"a network's file must be whole, got a place outside ({error}); fetch it again") from error
