"""Regular files of bounded size. A pipe would wait for ever, a device never end."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from ..records.errors import LiveHandError

MIB = 1 << 20


def check_regular(path: Path, most_bytes: int | None = None) -> int:
    """The size of a file, in bytes.

    Raises:
        LiveHandError: it is missing, no regular file, or larger than `most_bytes`.
    """
    try:
        status = path.stat()
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise LiveHandError(f"{_shown(path)} must be a readable file ({_reason(error)}); give another path") from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
        raise LiveHandError(f"{path} must be a regular file, got {kind}; give another path")
    if most_bytes is not None and status.st_size > most_bytes:
        raise LiveHandError(
            f"{path} must hold at most {most_bytes // MIB} MiB, got {status.st_size // MIB}; cut it into smaller files"
        )
    return status.st_size


def is_file(path: Path) -> bool:
    """Whether there is a regular file, also for paths that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether there is a folder, also for paths that none can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def read_regular(path: Path, most_bytes: int) -> bytes:
    """The content of a file.

    Raises:
        LiveHandError: as `check_regular`, or it cannot be read, or it grew while it was.
    """
    check_regular(path, most_bytes)
    try:
        # Should a pipe have taken the file's place, opening it does not wait.
        with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb") as file:
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise LiveHandError(f"{path} must be a readable file ({_reason(error)}); give another path") from error
    if len(content) > most_bytes:
        raise LiveHandError(f"{path} must hold at most {most_bytes // MIB} MiB, got more")
    return content


def _shown(path: Path) -> str:
    text = str(path).replace("\0", "\\0")
    return text if len(text) <= 300 else f"{text[:200]}..."


def _reason(error: Exception) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
