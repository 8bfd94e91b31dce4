"""Reads untrusted pickles of plain data: numbers, text, lists, dictionaries and numpy arrays.

HO-3D stores its annotations as such pickles. `numpy.save` of a dictionary, as in ARCTIC, writes one behind a header.
The globals that numpy's own unpickling would call are replaced by stand-ins; any other global is refused before it is
called.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ..hand.pickled_arrays import Array, ArrayKind, Dtype, RestrictedUnpickler, Stub, require
from ..system.pickle_scan import DEEPEST, scan_pickle

_MOST_NUMBERS = 50_000_000
_REFUSAL = "a pickle of poses may not use {}, which could run code; save plain numpy arrays as .npz instead"


def read_plain_pickle(raw: bytes) -> Any:
    """Read the content of a pickle.

    Raises:
        LiveHandError: the pickle names a global other than those of numpy arrays of plain numbers, or is too large,
            too deep or made of itself.
        Exception: a damaged pickle can raise nearly anything; the caller names the file.
    """
    scan_pickle(raw)
    return _Conversion().of(RestrictedUnpickler(io.BytesIO(raw), _ALLOWED, _REFUSAL).load())


class _AnyDtype(Dtype):
    """Plain numbers, or `object`, which is allowed only for the array around a dictionary."""

    def __new__(cls, code: Any, *flags: Any) -> Dtype:
        if code not in ("O", "O8"):
            return super().__new__(cls, code, *flags)
        dtype = object.__new__(cls)
        dtype.code = "O"
        return dtype


class _Scalar(Stub):
    """`numpy.core.multiarray.scalar(dtype, raw)`."""

    def __new__(cls, dtype: Any, raw: Any) -> _Scalar:
        scalar = object.__new__(cls)
        scalar.state = (dtype, raw)
        return scalar

    def numpy(self) -> np.ndarray:
        """Make the value, as an array without axes."""
        dtype, raw = self.state
        require(isinstance(dtype, Dtype) and dtype.code != "O", "numbers must be plain, got an object")
        return np.frombuffer(raw.encode("latin1") if isinstance(raw, str) else raw, dtype.numpy()).reshape(())


class _Buffer(Stub):
    """`numpy.core.numeric._frombuffer(raw, dtype, shape, order)`: arrays in pickles of protocol 5."""

    def __new__(cls, raw: Any, dtype: Any, shape: Any, order: Any) -> _Buffer:
        buffer = object.__new__(cls)
        buffer.state = (raw, dtype, shape, order)
        return buffer

    def numpy(self) -> np.ndarray:
        """Make the array."""
        raw, dtype, shape, order = self.state
        require(isinstance(dtype, Dtype) and dtype.code != "O", "arrays must hold plain numbers, got objects")
        return np.frombuffer(bytes(raw), dtype.numpy()).reshape(shape, order="F" if order == "F" else "C").copy()


class _Bytes(Stub):
    """`_codecs.encode(text, 'latin1')`: bytes in pickles of older protocols."""

    def __new__(cls, text: Any, encoding: Any) -> bytes:
        require(isinstance(text, str) and encoding == "latin1", f"text must be latin1, got {encoding!r}")
        return text.encode("latin1")


_ALLOWED = {
    f"{package}.{name}": stand_in
    for package in ("numpy.core", "numpy._core")
    for name, stand_in in (
        ("multiarray._reconstruct", Array),
        ("multiarray.scalar", _Scalar),
        ("numeric._frombuffer", _Buffer),
    )
} | {"numpy.ndarray": ArrayKind, "numpy.dtype": _AnyDtype, "_codecs.encode": _Bytes}


class _Conversion:
    """Replaces every stand-in by its array. What a pickle refers to many times is converted once, but counted each."""

    def __init__(self):
        self._done: dict[int, tuple[Any, int]] = {}
        self._open: set[int] = set()

    def of(self, value: Any) -> Any:
        """Convert the value to plain data."""
        return self._converted(value)[0]

    def _converted(self, value: Any) -> tuple[Any, int]:
        """Convert the value, and count how many numbers it holds once everything is written out."""
        key = id(value)
        if key in self._done:
            return self._done[key]
        if isinstance(value, dict | list | tuple | Stub):
            require(key not in self._open, "lists must not hold themselves; save plain numpy arrays as .npz instead")
            require(len(self._open) < DEEPEST, f"data must nest at most {DEEPEST} deep; save plain arrays as .npz")
            self._open.add(key)
            self._done[key] = self._of_parts(value)
            self._open.discard(key)
            return self._done[key]
        require(value is None or isinstance(value, str | bytes | int | float), f"must be plain data, got {type(value)}")
        return value, 1

    def _of_parts(self, value: Any) -> tuple[Any, int]:
        if isinstance(value, Array) and _is_wrapper(value):
            return self._converted(value.state[4][0])
        if isinstance(value, Array | _Scalar | _Buffer):
            array = value.numpy()
            return array, self._checked(array.size + 1)
        require(isinstance(value, dict | list | tuple), f"must be plain data, got {type(value)}")
        items = list(value.values()) if isinstance(value, dict) else value
        parts = [self._converted(item) for item in items]
        size = self._checked(1 + sum(count for _, count in parts))
        plain = [part for part, _ in parts]
        return dict(zip(map(str, value), plain, strict=True)) if isinstance(value, dict) else plain, size

    def _checked(self, size: int) -> int:
        require(size <= _MOST_NUMBERS, f"a pickle must hold at most {_MOST_NUMBERS} numbers; cut it into smaller files")
        return size


def _is_wrapper(array: Array) -> bool:
    """Tell whether the array is the one that `numpy.save` wraps a dictionary in."""
    _, shape, dtype, _, items = array.state
    is_object = isinstance(dtype, Dtype) and dtype.code == "O"
    require(
        not is_object or (shape == () and isinstance(items, list) and len(items) == 1),
        "arrays must hold plain numbers, got an array of objects",
    )
    return is_object
