"""Digests of the files that frames are made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

_WHOLE_BYTES = 1 << 28  # a file up to this size is read whole
_PIECE_BYTES, _PIECES = 1 << 20, 64


def file_digest(path: Path) -> str | None:
    """Hash a file with sha256; None: it cannot be read.

    Of a film of gigabytes it is that of its size and of 64 pieces of a MiB, the first and the last among them, with
    the prefix `pieces-`.
    """
    try:
        status = path.stat()
        return _digest(path, status.st_mtime_ns, status.st_size)
    except (OSError, ValueError):  # ValueError: a name with a NUL
        return None


def files_digest(paths: Iterable[Path]) -> str | None:
    """Hash the names and sizes of files with sha256, with the prefix `names-`; None: there are none."""
    found = sorted((path.name, path.stat().st_size) for path in paths if path.is_file())
    return f"names-{hashlib.sha256(repr(found).encode()).hexdigest()}" if found else None


@cache
def _digest(path: Path, changed_ns: int, size: int) -> str:
    """Hash a file, once per modification time and size."""
    with path.open("rb") as file:
        if size <= _WHOLE_BYTES:
            return hashlib.file_digest(file, "sha256").hexdigest()
        sha256 = hashlib.sha256(str(size).encode())
        for piece in range(_PIECES):
            file.seek(piece * (size - _PIECE_BYTES) // (_PIECES - 1))
            sha256.update(file.read(_PIECE_BYTES))
        return f"pieces-{sha256.hexdigest()}"
