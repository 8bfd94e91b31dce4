"""Files that are whole or not there: written under a temporary name beside their place, and renamed.

A temporary name, `.NAME.TOKEN-OWNER.partial.SUFFIX`, has a part that nobody can foresee, and names its process. What a
killed process leaves is removed by the next one that writes into the folder.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import time
from collections.abc import Generator
from functools import cache
from pathlib import Path

from ..records.errors import LiveHandError
from .process_identity import has_ended, process_name

_LONGEST_STEM = 100  # of a temporary name; a file system takes names of 255 bytes
_RETRIES, _RETRY_S = 10, 0.05
_LEFTOVER = re.compile(r"\..*\.[0-9a-f]{16}(?:-([0-9a-f]+-[0-9]+))?\.partial(?:\.[^.]*)?", re.DOTALL)
_STALE_S = 24 * 3600.0
"""After so long a temporary file is nobody's, even if its process cannot be asked."""


@contextlib.contextmanager
def replacing(path: Path, is_durable: bool = False) -> Generator[Path, None, None]:
    """Yields an empty file with the suffix of `path`, which takes its place at the end of the block; makes the folder.

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
    """Once: remove the temporary files of processes that are known to have ended, and those that are a day old."""
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
