"""Reads MANO v1.2's own `.pkl` files as untrusted input.

They are Python-2 pickles of protocol 2: numpy arrays, one scipy sparse matrix and one chumpy expression. A pickle calls
the globals that it names. Seven are allowed, and six of them are replaced by the stand-ins below, which only keep their
arguments until they have been checked: numpy's unpickling, scipy and chumpy never run. Any other global is refused
before it is called.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import MIB, read_regular
from ..system.pickle_scan import scan_pickle
from .pickled_arrays import Array, ArrayKind, Dtype, RestrictedUnpickler, Stub, require

# The file also holds strings, which are ignored.
_ARRAY_KEYS = (
    "v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs", "J",
    "hands_components", "hands_mean", "hands_coeffs",
)  # fmt: skip
_MOST_BYTES = 128 * MIB  # MANO's own are of 4
_MOST_ENTRIES = 1 << 22  # of 16 joints x 778 vertices, with room
_SHAPE_DIRECTIONS = 10  # the file holds 20; MANO uses the first ten


def read_mano_pickle(path: Path | str) -> dict[str, np.ndarray]:
    """Read the arrays of a MANO `.pkl` under their own names; `J_regressor` dense, `shapedirs` the first ten.

    Raises:
        LiveHandError: the file is damaged, names a global that is not allowed, or holds anything but plain numbers in
            an array.
    """
    path = Path(path)
    try:
        raw = read_regular(path, _MOST_BYTES)
        scan_pickle(raw)
        refusal = "a MANO pickle may not use {}; use the unchanged file from MANO's website"
        content = RestrictedUnpickler(BytesIO(raw), _ALLOWED, refusal).load()
        require(isinstance(content, dict), f"the file must hold a dictionary, got {type(content).__name__}")
        return {key: _as_array(content[key], key) for key in _ARRAY_KEYS if key in content}
    except LiveHandError as error:
        raise LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged pickle can raise nearly anything
        raise LiveHandError(
            f"{path} must be MANO v1.2's own .pkl, got a file that cannot be read ({type(error).__name__}: {error}); "
            "download it again from MANO's website"
        ) from error


class _SparseColumns(Stub):
    """`scipy.sparse.csc.csc_matrix`."""

    def numpy(self) -> np.ndarray:
        """Make the dense matrix."""
        rows, columns = self.entry("_shape")
        starts, index, values = (_as_array(self.entry(key), key) for key in ("indptr", "indices", "data"))
        require(
            len(starts) == columns + 1 and int(starts[-1]) == len(index) == len(values),
            f"a sparse matrix must hold {columns} columns, got arrays of {len(starts)}, {len(index)}, {len(values)}",
        )
        require(
            all(isinstance(side, int) and 0 < side for side in (rows, columns)) and rows * columns <= _MOST_ENTRIES,
            f"a sparse matrix must be one of a hand's, got {rows} x {columns}",
        )
        matrix = np.zeros((rows, columns))
        np.add.at(matrix, (index, np.repeat(np.arange(columns), np.diff(starts))), values)
        return matrix


class _Variable(Stub):
    """`chumpy.ch.Ch`: a leaf, the array `x`."""

    def numpy(self) -> np.ndarray:
        """Make the value."""
        return _as_array(self.entry("x"), "x")


class _Selection(Stub):
    """`chumpy.reordering.Select`: the entries `idxs` of the flattened leaf `a`, shaped as `preferred_shape`."""

    def numpy(self) -> np.ndarray:
        """Make the value."""
        leaf = self.entry("a")
        require(isinstance(leaf, _Variable), f"a selection must be of a Ch, got {type(leaf).__name__}")
        picked = leaf.numpy().ravel()[_as_array(self.entry("idxs"), "idxs")]
        return picked.reshape(self.entry("preferred_shape"))[..., :_SHAPE_DIRECTIONS]


_ALLOWED = {
    "numpy.core.multiarray._reconstruct": Array,
    "numpy.ndarray": ArrayKind,
    "numpy.dtype": Dtype,
    "scipy.sparse.csc.csc_matrix": _SparseColumns,
    "chumpy.reordering.Select": _Selection,
    "chumpy.ch.Ch": _Variable,
    "__builtin__.set": set,
}


def _as_array(value: Any, name: str) -> np.ndarray:
    require(
        isinstance(value, Array | _SparseColumns | _Variable | _Selection),
        f"{name} must be an array, got {type(value).__name__.strip('_')}",
    )
    return value.numpy()
