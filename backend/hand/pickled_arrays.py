"""An unpickler for untrusted pickles, and stand-ins for numpy's classes in them.

The stand-ins only keep their arguments until they have been checked, so that numpy's unpickling never runs.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Mapping
from io import BufferedIOBase
from typing import Any

import numpy as np

from ..records.errors import LiveHandError

_NUMBER_CODE = re.compile(r"[biuf][1248]")  # booleans, integers and floats; no objects or records


class RestrictedUnpickler(pickle.Unpickler):
    """An unpickler that allows only the given globals and replaces them by stand-ins."""

    def __init__(self, file: BufferedIOBase, allowed: Mapping[str, Any], refusal: str):
        """Allow these globals only; `refusal` is the message about any other one, with {} for its name."""
        super().__init__(file, encoding="latin1")
        self._allowed, self._refusal = allowed, refusal

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        """Find the stand-in of a global.

        Raises:
            LiveHandError: the global is not allowed.
        """
        name = f"{module_name}.{global_name}"
        require(name in self._allowed, self._refusal.format(name))
        return self._allowed[name]


class Stub:
    """A stand-in for a foreign class that keeps its state. It takes no arguments unless a subclass does."""

    state: Any = None

    def __new__(cls) -> Stub:
        """Take no arguments."""
        return object.__new__(cls)

    def __setstate__(self, state: Any) -> None:
        object.__setattr__(self, "state", state)

    def entry(self, key: str) -> Any:
        """Look up an entry of the state, which must be a dictionary."""
        require(isinstance(self.state, dict) and key in self.state, f"{type(self).__name__[1:]} must have {key!r}")
        return self.state[key]


class Dtype(Stub):
    """`numpy.dtype` of plain numbers."""

    code: str

    def __new__(cls, code: Any, *_flags: Any) -> Dtype:
        """Make it from one of numpy's codes of plain numbers."""
        require(
            isinstance(code, str) and _NUMBER_CODE.fullmatch(code) is not None,
            f"arrays must hold plain numbers, got dtype {code!r}; object arrays can run code and are refused",
        )
        dtype = object.__new__(cls)
        dtype.code = code
        return dtype

    def numpy(self) -> np.dtype:
        """Make the type with its byte order. Its state is (version, byte order, subarray, names, fields, ...)."""
        order, *inner = self.state[1:5]
        require(order in ("<", ">", "|") and inner == [None] * 3, f"arrays must hold plain numbers, got {self.state!r}")
        return np.dtype(order + self.code)


class ArrayKind(Stub):
    """`numpy.ndarray`, which may only be named as the first argument of `Array`."""

    def __new__(cls) -> ArrayKind:
        """Refuse to be called."""
        raise LiveHandError("numpy.ndarray may be named in a pickle, not called; download the file again")


class Array(Stub):
    """`numpy.core.multiarray._reconstruct(ndarray, (0,), 'b')`: an empty array whose state follows."""

    def __new__(cls, kind: Any, *_placeholder: Any) -> Array:
        """Make it from numpy's own class, empty."""
        require(kind is ArrayKind, f"arrays must be of numpy's own class, got {kind!r}")
        return object.__new__(cls)

    def numpy(self) -> np.ndarray:
        """Make the array. Its state is (version, shape, dtype, is Fortran-ordered, raw data as bytes or latin-1)."""
        _, shape, dtype, is_fortran, raw = self.state
        require(
            isinstance(dtype, Dtype) and isinstance(raw, str | bytes),
            "arrays must hold raw numbers, got a list of objects",
        )
        values = np.frombuffer(raw.encode("latin1") if isinstance(raw, str) else raw, dtype.numpy())
        return values.reshape(shape, order="F" if is_fortran else "C").copy()


def require(holds: bool, message: str) -> None:
    """Raise a `LiveHandError` with the message unless the condition holds."""
    if not holds:
        raise LiveHandError(message)
