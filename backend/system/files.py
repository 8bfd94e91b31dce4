"""Files: where they are kept, opened within bounds, and written whole or not at all.

A temporary name, `.NAME.TOKEN-OWNER.partial.SUFFIX`, has a part that nobody can foresee, and names its process. What a
killed process leaves is removed by the next one that writes into the folder.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
import sys
import time
from collections.abc import Generator
from functools import cache
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..records.errors import LiveHandError
from .processes import has_ended, process_name


def data_folder() -> Path:
    """Return the folder of all programs' data: `XDG_DATA_HOME`, or the system's own."""
    if configured := os.environ.get("XDG_DATA_HOME"):
        return Path(configured)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support"
    return Path.home() / ".local" / "share"


MIB = 1 << 20


def check_regular(path: Path, most_bytes: int | None = None) -> int:
    """Return the size of a file, in bytes, after a check that it is a regular one.

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
    """Return whether there is a regular file, also for paths that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Return whether there is a folder, also for paths that none can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def read_regular(path: Path, most_bytes: int) -> bytes:
    """Read the content of a file.

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


def inner_path(folder: Path, name: object, follows_links: bool = False) -> Path:
    """Return the path of a name in a folder.

    Args:
        folder: that must hold it.
        name: as a file gives it.
        follows_links: links must not lead out of the folder either.

    Raises:
        LiveHandError: the name is no text, is absolute, or leads out of the folder.
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise LiveHandError(f"a file's name must be text, got {str(name)[:40]!r}")
    kinds = (PurePosixPath(name), PureWindowsPath(name))
    if any(kind.is_absolute() or kind.anchor or ".." in kind.parts for kind in kinds):
        raise LiveHandError(f"{name[:200]} must lie inside {folder}, got a path that leads out of it")
    path = folder / name
    try:
        is_inside = not follows_links or path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:
        raise LiveHandError(f"{name[:200]} must be a file's name ({error})") from error
    if not is_inside:
        raise LiveHandError(f"{path} must lie inside {folder}, got a link that leads out of it")
    return path


_LONGEST_STEM = 100  # of a temporary name; a file system takes names of 255 bytes
_RETRIES, _RETRY_S = 10, 0.05
_LEFTOVER = re.compile(r"\..*\.[0-9a-f]{16}(?:-([0-9a-f]+-[0-9]+))?\.partial(?:\.[^.]*)?", re.DOTALL)
_STALE_S = 24 * 3600.0
"""After so long a temporary file is nobody's, even if its process cannot be asked."""


@contextlib.contextmanager
def replacing(path: Path, is_durable: bool = False) -> Generator[Path, None, None]:
    """Yield an empty file with the suffix of `path`, which takes its place at the end of the block; makes the folder.

    If the block fails, the file is removed and `path` is as before. Nobody can foresee the file's name, and it is
    created exclusively, so it is never somebody else's.

    Args:
        path: the file to write.
        is_durable: the file is on the disk before it takes its place, so that one of the two survives a power failure.

    Raises:
        LiveHandError: the file cannot be written.
    """
    stem = path.stem.encode()[:_LONGEST_STEM].decode(errors="ignore")
    temporary = path.with_name(f".{stem}.{secrets.token_hex(8)}-{process_name()}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
            _remove_leftovers(path.parent.absolute())
            yield temporary
            if is_durable:
                with temporary.open("rb+") as file:
                    os.fsync(file.fileno())
            rename_over(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise LiveHandError(f"{path} must be writable ({error}); make room, or choose another folder") from error


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove, once, temporary files of processes that are known to have ended, and those that are a day old."""
    for path in folder.iterdir():
        match = _LEFTOVER.fullmatch(path.name)
        with contextlib.suppress(OSError):  # another process removes it, or it is another user's
            if match and (has_ended(match[1] or "") or time.time() - path.lstat().st_mtime > _STALE_S):
                path.unlink()


def rename_over(source: Path, target: Path) -> None:
    """Rename a file, replacing another; Windows refuses while somebody reads that one, so there it is tried again."""
    for _ in range(_RETRIES if os.name == "nt" else 0):
        with contextlib.suppress(PermissionError):
            os.replace(source, target)
            return
        time.sleep(_RETRY_S)
    os.replace(source, target)
