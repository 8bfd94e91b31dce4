"""Reads MANO v1.2's own `.pkl` files without trusting them.

They are Python-2 pickles of protocol 2: numpy arrays, one scipy sparse matrix and one chumpy expression. A pickle is a
program that calls what it names. Ours may name seven things; six of them are given as the plain stand-ins below, which
keep what they are handed and compute nothing until they have been checked, so that neither numpy's unpickling nor scipy
nor chumpy ever runs. Anything else is refused by its name, before it is called.
"""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import LiveHandError

# What is handed on; the file also holds strings.
_ARRAY_KEYS = (
    "v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs", "J",
    "hands_components", "hands_mean", "hands_coeffs",
)  # fmt: skip
_SHAPE_DIRECTIONS = 10  # the file's leaf array holds 20; MANO uses the first ten
_NUMBER_CODE = re.compile(r"[biuf][1248]")  # numpy's codes of booleans, integers and floats: no objects, no records


def read_mano_pickle(path: Path | str) -> dict[str, np.ndarray]:
    """The arrays of a MANO `.pkl` under their own names; `J_regressor` dense, `shapedirs` the first ten.

    Raises:
        LiveHandError: the file is cut off, is no pickle, names anything beyond MANO's seven globals, or holds something
            other than plain numbers where an array is due.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = _MANOUnpickler(file, encoding="latin1").load()
        _require(isinstance(content, dict), f"the file must hold a dictionary, got {type(content).__name__}")
        return {key: _as_array(content[key], key) for key in _ARRAY_KEYS if key in content}
    except LiveHandError as error:
        raise LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged pickle can raise nearly anything
        raise LiveHandError(
            f"{path} must be MANO v1.2's own .pkl, got a file that cannot be read ({type(error).__name__}: {error}); "
            "download it again from MANO's website"
        ) from error


class _Stub:
    """Stands in for a foreign class: keeps the state it is given. Made without arguments unless a subclass says so."""

    state: Any = None

    def __new__(cls) -> _Stub:
        return object.__new__(cls)

    def __setstate__(self, state: Any) -> None:
        object.__setattr__(self, "state", state)

    def entry(self, key: str) -> Any:
        """One entry of a state that must be a dictionary."""
        _require(isinstance(self.state, dict) and key in self.state, f"{type(self).__name__[1:]} must have {key!r}")
        return self.state[key]


class _Dtype(_Stub):
    """`numpy.dtype`, of plain numbers only."""

    code: str

    def __new__(cls, code: Any, *_flags: Any) -> _Dtype:
        _require(
            isinstance(code, str) and _NUMBER_CODE.fullmatch(code) is not None,
            f"arrays must hold plain numbers, got dtype {code!r}; object arrays can run code and are refused",
        )
        dtype = object.__new__(cls)
        dtype.code = code
        return dtype

    def numpy(self) -> np.dtype:
        """The type with its byte order. Its state is (version, byte order, subarray, names, fields, ...)."""
        order, *inner = self.state[1:5]
        _require(
            order in ("<", ">", "|") and inner == [None] * 3, f"arrays must hold plain numbers, got {self.state!r}"
        )
        return np.dtype(order + self.code)


class _ArrayKind(_Stub):
    """`numpy.ndarray`: only ever named, as `_Array`'s first argument."""

    def __new__(cls) -> _ArrayKind:
        raise LiveHandError("numpy.ndarray may be named, not called; the file is not MANO's own")


class _Array(_Stub):
    """`numpy.core.multiarray._reconstruct(ndarray, (0,), 'b')`: an empty array whose state follows."""

    def __new__(cls, kind: Any, *_placeholder: Any) -> _Array:
        _require(kind is _ArrayKind, f"arrays must be of numpy's own class, got {kind!r}")
        return object.__new__(cls)

    def numpy(self) -> np.ndarray:
        """The array. Its state is (version, shape, dtype, is Fortran-ordered, raw data as latin-1 text)."""
        _, shape, dtype, is_fortran, raw = self.state
        _require(
            isinstance(dtype, _Dtype) and isinstance(raw, str), "arrays must hold raw numbers, got a list of objects"
        )
        values = np.frombuffer(raw.encode("latin1"), dtype.numpy())
        return values.reshape(shape, order="F" if is_fortran else "C").copy()


class _SparseColumns(_Stub):
    """`scipy.sparse.csc.csc_matrix`."""

    def numpy(self) -> np.ndarray:
        """The dense matrix."""
        rows, columns = self.entry("_shape")
        starts, index, values = (_as_array(self.entry(key), key) for key in ("indptr", "indices", "data"))
        _require(
            len(starts) == columns + 1 and int(starts[-1]) == len(index) == len(values),
            f"a sparse matrix must hold {columns} columns, got arrays of {len(starts)}, {len(index)}, {len(values)}",
        )
        matrix = np.zeros((rows, columns))
        np.add.at(matrix, (index, np.repeat(np.arange(columns), np.diff(starts))), values)
        return matrix


class _Variable(_Stub):
    """`chumpy.ch.Ch`: a leaf, the array `x`."""

    def numpy(self) -> np.ndarray:
        """Its value."""
        return _as_array(self.entry("x"), "x")


class _Selection(_Stub):
    """`chumpy.reordering.Select`: the entries `idxs` of the flattened leaf `a`, shaped as `preferred_shape`."""

    def numpy(self) -> np.ndarray:
        """Its value."""
        leaf = self.entry("a")
        _require(isinstance(leaf, _Variable), f"a selection must be of a Ch, got {type(leaf).__name__}")
        picked = leaf.numpy().ravel()[_as_array(self.entry("idxs"), "idxs")]
        return picked.reshape(self.entry("preferred_shape"))[..., :_SHAPE_DIRECTIONS]


_ALLOWED = {
    "numpy.core.multiarray._reconstruct": _Array,
    "numpy.ndarray": _ArrayKind,
    "numpy.dtype": _Dtype,
    "scipy.sparse.csc.csc_matrix": _SparseColumns,
    "chumpy.reordering.Select": _Selection,
    "chumpy.ch.Ch": _Variable,
    "__builtin__.set": set,
}


class _MANOUnpickler(pickle.Unpickler):
    """An unpickler that knows MANO's seven globals and no other."""

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        """The stand-in of a global.

        Raises:
            LiveHandError: it is not one of the seven.
        """
        name = f"{module_name}.{global_name}"
        _require(name in _ALLOWED, f"a MANO pickle may not use {name}; use the unchanged file from MANO's website")
        return _ALLOWED[name]


def _as_array(value: Any, name: str) -> np.ndarray:
    _require(
        isinstance(value, _Array | _SparseColumns | _Variable | _Selection),
        f"{name} must be an array, got {type(value).__name__.strip('_')}",
    )
    return value.numpy()


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise LiveHandError(message)
