"""Where compiled kernels are kept: in the user's cache, else in a temporary folder of the user's own, else nowhere."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

_ROOM_BYTES = 1 << 25  # that all compiled kernels may take: numba fails where it cannot keep it


def writable_cache(configured: str) -> Path | None:
    """The first of these folders that takes files, as home and installation of a farm's machines often do not.

    Args:
        configured: numba's own setting; empty if there is none.
    """
    return next((folder for folder in _candidates(configured) if _takes_files(folder)), None)


def _candidates(configured: str) -> Iterator[Path]:
    with contextlib.suppress(RuntimeError):  # no home at all
        yield Path(configured or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "livehand"
    with contextlib.suppress(OSError):  # no temporary folder
        folder = Path(tempfile.gettempdir()) / f"livehand-{_user()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        if _is_private(folder):
            yield folder


def _is_private(folder: Path) -> bool:
    """Whether nobody else can write to the folder: numba runs what lies there. On Windows, temporary folders are so."""
    info = folder.lstat()
    is_shut = info.st_uid == _user() and not info.st_mode & 0o022
    return stat.S_ISDIR(info.st_mode) and (is_shut or not hasattr(os, "getuid"))


def _user() -> int:
    """The user's number; Windows has none."""
    return os.getuid() if hasattr(os, "getuid") else 0


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_ROOM_BYTES))
        return True
    except OSError:
        return False
