"""Files that are whole or not there: written under a temporary name beside their place, and renamed."""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections.abc import Generator
from pathlib import Path

from ..records.errors import LiveHandError

_LONGEST_STEM = 100  # of a temporary name; a file system takes names of 255 bytes
_RETRIES, _RETRY_S = 10, 0.05


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
    temporary = path.with_name(f".{stem}.{secrets.token_hex(8)}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
            yield temporary
            if is_durable:
                with temporary.open("rb+") as file:
                    os.fsync(file.fileno())
            rename_over(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise LiveHandError(f"{path} must be writable ({error}); make room, or choose another folder") from error


def rename_over(source: Path, target: Path) -> None:
    """Rename a file, replacing another; Windows refuses while somebody reads that one, so there it is tried again."""
    for _ in range(_RETRIES if os.name == "nt" else 0):
        with contextlib.suppress(PermissionError):
            os.replace(source, target)
            return
        time.sleep(_RETRY_S)
    os.replace(source, target)
