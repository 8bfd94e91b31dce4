"""The content of a pose file of any format: arrays, lists and dictionaries, read without running code."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import MIB, is_file, read_regular
from ..system.readers import (
    MOST_JSON_BYTES,
    MOST_NPZ_BYTES,
    Npz,
    parse_json,
    read_json,
    read_npy_header,
    read_npz_parts,
)
from .plain_pickle import read_plain_pickle

_MOST_TABLE_BYTES = 64 * MIB
_MOST_NAMES, _LONGEST_NAME = 12, 40  # of keys, in a message


@dataclass(frozen=True)
class Document:
    """The content of one file.

    Attributes:
        path: of the file.
        content: a dictionary, list or array, with numbers as the file stores them.
        packed: the members of a `.npz` that hold Python objects, unread.
    """

    path: Path
    content: Any
    packed: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def keys_in_words(self) -> str:
        """Name the first of the content's keys, and how many more there are."""
        names = sorted(map(str, self.entries))
        shown = ", ".join(name[:_LONGEST_NAME] for name in names[:_MOST_NAMES])
        return f"{shown} and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else shown or "none"

    def unpacked(self, name: str) -> Any:
        """Read a member of a `.npz` that holds Python objects as `plain_pickle` does; None: there is none.

        Raises:
            LiveHandError: it holds more than plain data, or is damaged.
        """
        if name not in self.packed:
            return self.entries.get(name)
        try:
            return read_plain_pickle(self.packed[name])
        except LiveHandError as error:
            raise LiveHandError(f"{self.path}: {name}: {error}") from error
        except Exception as error:  # a damaged pickle can raise nearly anything
            raise LiveHandError(
                f"{self.path}: {name} must be a readable pickle, got {type(error).__name__}; export it again"
            ) from error

    @property
    def entries(self) -> dict[str, Any]:
        """The content if it is a dictionary, else an empty one."""
        return self.content if isinstance(self.content, dict) else {}

    def array(self, value: Any, name: str, *shapes: Sequence[int | None]) -> np.ndarray:
        """Read a value of the content as a float64 array of one of the shapes; None stands for any length.

        Raises:
            LiveHandError: the value is not numeric, has another shape, or is not finite.
        """
        try:
            array = np.asarray(value)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise LiveHandError(f"{self.path}: {name} must be an array, got rows of different lengths") from error
        if array.dtype.kind not in "biuf":
            raise LiveHandError(f"{self.path}: {name} must hold numbers, got {array.dtype}; export it again")
        if shapes and not any(_fits(array.shape, shape) for shape in shapes):
            wanted = " or ".join(str(["N" if n is None else n for n in shape]) for shape in shapes)
            raise LiveHandError(f"{self.path}: {name} must be {wanted}, got {list(array.shape)}; export it again")
        array = array.astype(np.float64)
        if not np.isfinite(array).all():
            raise LiveHandError(
                f"{self.path}: {name} must be finite, got NaN or infinity; repair the file or track the hand again"
            )
        return array


def load_document(path: Path) -> Document:
    """Read a file by its suffix. Pickles are restricted by `plain_pickle`; objects in a `.npz` stay unread.

    Raises:
        LiveHandError: the file is missing, has another suffix, is damaged or too large, or is a pickle that could run
            code.
    """
    if not is_file(path):
        raise LiveHandError(f"no pose file at {path}; give the path of one of {', '.join(SUFFIXES)}")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LiveHandError(f"{path} must be a pose file ({', '.join(SUFFIXES)}), got '{path.suffix}'")
    try:
        content = _READERS[suffix](path)
        return Document(path, *content) if isinstance(content, Npz) else Document(path, content)
    except LiveHandError as error:
        raise error if str(path) in str(error) else LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged file can raise nearly anything
        raise LiveHandError(
            f"{path} must be a readable {suffix} file, got {type(error).__name__}: {str(error)[:200]}; export it again"
        ) from error


def _read_npy(path: Path) -> Any:
    raw = read_regular(path, MOST_NPZ_BYTES)
    file = io.BytesIO(raw)
    shape, dtype = read_npy_header(file)
    if dtype.hasobject:
        return read_plain_pickle(raw[file.tell() :])
    if prod(shape) * dtype.itemsize != len(raw) - file.tell():
        raise LiveHandError(f"an array of shape {list(shape)} must be whole, got {len(raw) - file.tell()} bytes")
    return np.load(io.BytesIO(raw), allow_pickle=False)


def _read_pickle(path: Path) -> Any:
    return read_plain_pickle(read_regular(path, MOST_NPZ_BYTES))


def _read_json_lines(path: Path) -> list[Any]:
    """Read a document on each line, as trackers write that send one frame after another."""
    lines = read_regular(path, MOST_JSON_BYTES).splitlines()
    return [parse_json(line, f"line {number}") for number, line in enumerate(lines, 1) if line.strip()]


def _read_csv(path: Path) -> dict[str, np.ndarray] | np.ndarray:
    """Read the columns of a table by their names, or all numbers of one without names; an empty cell is NaN."""
    text = read_regular(path, _MOST_TABLE_BYTES).decode("utf-8-sig")
    separator = next((mark for mark in ";\t" if mark in text.partition("\n")[0]), ",")
    lines = csv.reader(text.splitlines(), delimiter=separator)
    # Separators alone are a frame without a hand.
    rows = [row for row in lines if len(row) > 1 or "".join(row).strip()] or [[]]
    if any(len(row) != len(rows[0]) for row in rows):
        raise LiveHandError("a table must have as many cells in every line")
    names, *cells = rows
    if all(_is_number(name) for name in names):
        columns = [_column(column, separator) for column in zip(*rows, strict=True)]
        return np.stack(columns, 1) if columns else np.zeros((0, 0))
    if not cells:
        raise LiveHandError("a table must have lines below its header, got none")
    columns = zip(names, zip(*cells, strict=True), strict=True)
    return {name.strip(): _column(column, separator) for name, column in columns}


def _column(cells: Sequence[str], separator: str) -> np.ndarray:
    try:
        return np.array([_number(cell, separator) for cell in cells])
    except ValueError:
        return np.array([cell.strip() for cell in cells])


def _number(cell: str, separator: str) -> float:
    """Read a cell's number; tables with other separators may have decimal commas."""
    if not cell.strip() or cell.strip().lower() in ("none", "null"):
        return np.nan
    return float(cell if separator == "," else cell.replace(",", "."))


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell.replace(",", ".")))
    except ValueError:
        return False


_READERS: dict[str, Callable[[Path], Any]] = {
    ".npz": read_npz_parts,
    ".npy": _read_npy,
    ".json": read_json,
    ".jsonl": _read_json_lines,
    ".pkl": _read_pickle,
    ".csv": _read_csv,
}
SUFFIXES = tuple(_READERS)


def _fits(shape: tuple[int, ...], wanted: Sequence[int | None]) -> bool:
    return len(shape) == len(wanted) and all(n is None or n == m for m, n in zip(shape, wanted, strict=True))


def shape_of(value: Any) -> tuple[int, ...]:
    """Return the shape of an array or of nested lists; () where rows differ in length."""
    try:
        return np.shape(value)
    except ValueError:
        return ()
