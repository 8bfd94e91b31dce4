# pyright: basic
"""Readers of JSON, npz and picture files of other people, within bounds on what they may claim.

Pillow would otherwise try all of its formats on a file, some of which start other programs, whatever the name says.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedIOBase
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..records.errors import LiveHandError
from .files import MIB, check_regular, read_regular

if TYPE_CHECKING:
    from PIL.Image import Image as Picture


MOST_JSON_BYTES = 128 * MIB
_DEEPEST = 60
_LONGEST_INTEGER = 18  # digits that a whole number of 64 bits always holds
_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)
_OTHERS = bytes(set(range(256)) - set(b"[]{}"))


def read_json(path: Path, most_bytes: int = MOST_JSON_BYTES) -> Any:
    """Read the document of a JSON file; whole numbers of more than 18 digits are read as floats.

    Raises:
        LiveHandError: the file is missing, damaged, too large or nested too deeply.
    """
    return parse_json(read_regular(path, most_bytes), str(path))


def parse_json(raw: bytes, subject: str) -> Any:
    """Parse the document of a text in JSON.

    Raises:
        LiveHandError: as `read_json`, about the subject.
    """
    if nesting(raw) > _DEEPEST:
        raise LiveHandError(f"{subject} must nest lists and objects at most {_DEEPEST} deep, got {nesting(raw)}")
    try:
        return json.loads(raw.decode("utf-8-sig"), parse_int=_integer)
    except (ValueError, RecursionError, MemoryError) as error:
        raise LiveHandError(
            f"{subject} must be well-formed JSON, got {type(error).__name__}: {str(error)[:200]}"
        ) from error


def nesting(raw: bytes) -> int:
    """Measure how deeply lists and objects nest in a text, brackets within its strings aside."""
    brackets = np.frombuffer(_TEXT.sub(b"", raw).translate(None, _OTHERS), np.uint8)
    opens = (brackets == ord("[")) | (brackets == ord("{"))
    return int(np.cumsum(np.where(opens, 1, -1)).max(initial=0))


def _integer(text: str) -> int | float:
    return int(text) if len(text) <= _LONGEST_INTEGER else float(text)


MOST_NPZ_BYTES = 512 * MIB
"""Of the arrays of one file; half of it for the file itself would do, were it not for files that are not packed."""
_MOST_ARRAYS = 4096
_LONGEST_HEADER_BYTES = 1 << 16


class Npz(NamedTuple):
    """A `.npz`: arrays by name, and the pickles of those members that hold Python objects, unread."""

    arrays: dict[str, np.ndarray]
    packed: dict[str, bytes]


def read_npz(path: Path, most_bytes: int = MOST_NPZ_BYTES) -> dict[str, np.ndarray]:
    """Read the arrays of a `.npz` by name.

    Raises:
        LiveHandError: the file is missing, damaged, too large, encrypted, or holds Python objects.
    """
    arrays, packed = read_npz_parts(path, most_bytes)
    if packed:
        raise LiveHandError(
            f"{path}: {next(iter(packed))} is an array of Python objects, which could run code; save plain arrays of "
            "numbers instead"
        )
    return arrays


def read_npz_parts(path: Path, most_bytes: int = MOST_NPZ_BYTES) -> Npz:
    """Read the arrays of a `.npz` by name, and leave members of Python objects unread.

    Raises:
        LiveHandError: the file is missing, damaged, too large or encrypted.
    """
    raw, found = read_regular(path, most_bytes), Npz({}, {})
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = archive.infolist()
            _check_members(members, most_bytes)
            for member in members:
                value, name = _read_member(archive, member), member.filename.removesuffix(".npy")
                if isinstance(value, bytes):
                    found.packed[name] = value
                else:
                    found.arrays[name] = value
            return found
    except LiveHandError as error:
        raise LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged archive can raise nearly anything
        raise LiveHandError(
            f"{path} must be a readable .npz file, got {type(error).__name__}: {error}; export it again"
        ) from error


def npz_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Compress arrays to a file's bytes; numpy's own writer complains once more, later, about a disk that is full."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def read_npy_header(file: BufferedIOBase) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Read the shape and type of the array whose `.npy` header begins here; the file is then at its first byte.

    Raises:
        ValueError: it is no header.
    """
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version} of the format; save the arrays with numpy.savez")
    try:
        shape, _, dtype = readers[version](file, max_header_size=_LONGEST_HEADER_BYTES)  # pyright: ignore[reportCallIssue]
    except (SyntaxError, TypeError, RecursionError, MemoryError) as error:
        raise ValueError(f"a header that is damaged ({type(error).__name__})") from error
    if min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {list(shape)}")
    return shape, dtype


def _check_members(members: list[zipfile.ZipInfo], most_bytes: int) -> None:
    if len(members) > _MOST_ARRAYS:
        raise LiveHandError(f"a .npz must hold at most {_MOST_ARRAYS} arrays, got {len(members)}")
    size = sum(member.file_size for member in members)
    if size > most_bytes:
        raise LiveHandError(f"its arrays must hold at most {most_bytes // MIB} MiB, got {size // MIB} unpacked")
    if any(member.flag_bits & 1 for member in members):
        raise LiveHandError("a .npz must not be encrypted; save the arrays with numpy.savez")


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray | bytes:
    """Read a member's array; of one of Python objects, its pickle."""
    with archive.open(member) as file:
        raw = io.BytesIO(file.read())
    shape, dtype = read_npy_header(raw)
    name = member.filename.removesuffix(".npy")
    if dtype.hasobject:
        return raw.read()
    claimed, there = prod(shape) * dtype.itemsize, member.file_size - raw.tell()
    if claimed != there:
        raise LiveHandError(f"{name} must be whole, got {there} bytes of {claimed} for shape {list(shape)}")
    raw.seek(0)
    return np.lib.format.read_array(raw, allow_pickle=False)


FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
MOST_PICTURE_BYTES = 1024 * MIB
MOST_PIXELS = 1 << 27
"""As many as 16384 x 8192."""


@contextmanager
def opened_picture(path: Path, formats: tuple[str, ...] = FORMATS) -> Iterator[Picture]:
    """Open an image whose header has been read and checked.

    Raises:
        LiveHandError: the file is missing, no regular file, of another format, damaged, or too large; also while its
            pixels are decoded in the context.
    """
    from PIL import Image

    try:
        check_regular(path, MOST_PICTURE_BYTES)
    except LiveHandError as error:
        raise LiveHandError(f"{path} must be a readable image ({error})") from error
    try:
        with Image.open(path, formats=formats) as picture:
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise LiveHandError(f"{path} must have at most {MOST_PIXELS} pixels, got {width} x {height}")
            yield picture
    except LiveHandError:
        raise
    except Exception as error:  # a damaged image can raise nearly anything
        raise LiveHandError(
            f"{path} must be a readable image ({', '.join(formats)}), got {type(error).__name__}: {error}"
        ) from error
