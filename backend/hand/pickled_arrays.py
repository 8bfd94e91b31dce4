"""Stand-ins for numpy's own classes in pickles that nobody trusts.

They keep what they are handed and compute nothing until it has been checked, so that numpy's unpickling never runs.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..records.errors import LiveHandError

_NUMBER_CODE = re.compile(r"[biuf][1248]")  # numpy's codes of booleans, integers and floats: no objects, no records


class Stub:
    """Stands in for a foreign class: keeps the state it is given. Made without arguments unless a subclass says so."""

    state: Any = None

    def __new__(cls) -> Stub:
        """Without arguments."""
        return object.__new__(cls)

    def __setstate__(self, state: Any) -> None:
        object.__setattr__(self, "state", state)

    def entry(self, key: str) -> Any:
        """One entry of a state that must be a dictionary."""
        require(isinstance(self.state, dict) and key in self.state, f"{type(self).__name__[1:]} must have {key!r}")
        return self.state[key]


class Dtype(Stub):
    """`numpy.dtype`, of plain numbers only."""

    code: str

    def __new__(cls, code: Any, *_flags: Any) -> Dtype:
        """Of one of numpy's codes of numbers."""
        require(
            isinstance(code, str) and _NUMBER_CODE.fullmatch(code) is not None,
            f"arrays must hold plain numbers, got dtype {code!r}; object arrays can run code and are refused",
        )
        dtype = object.__new__(cls)
        dtype.code = code
        return dtype

    def numpy(self) -> np.dtype:
        """The type with its byte order. Its state is (version, byte order, subarray, names, fields, ...)."""
        order, *inner = self.state[1:5]
        require(order in ("<", ">", "|") and inner == [None] * 3, f"arrays must hold plain numbers, got {self.state!r}")
        return np.dtype(order + self.code)


class ArrayKind(Stub):
    """`numpy.ndarray`: only ever named, as `Array`'s first argument."""

    def __new__(cls) -> ArrayKind:
        """Refused."""
        raise LiveHandError("numpy.ndarray may be named, not called; the file is not what it seems")


class Array(Stub):
    """`numpy.core.multiarray._reconstruct(ndarray, (0,), 'b')`: an empty array whose state follows."""

    def __new__(cls, kind: Any, *_placeholder: Any) -> Array:
        """Of numpy's own class, empty."""
        require(kind is ArrayKind, f"arrays must be of numpy's own class, got {kind!r}")
        return object.__new__(cls)

    def numpy(self) -> np.ndarray:
        """The array. Its state is (version, shape, dtype, is Fortran-ordered, raw data as bytes or latin-1 text)."""
        _, shape, dtype, is_fortran, raw = self.state
        require(
            isinstance(dtype, Dtype) and isinstance(raw, str | bytes),
            "arrays must hold raw numbers, got a list of objects",
        )
        values = np.frombuffer(raw.encode("latin1") if isinstance(raw, str) else raw, dtype.numpy())
        return values.reshape(shape, order="F" if is_fortran else "C").copy()


def require(holds: bool, message: str) -> None:
    """Raise a `LiveHandError` unless it holds."""
    if not holds:
        raise LiveHandError(message)
