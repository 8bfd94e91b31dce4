"""The folders that frames are written to."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..records.errors import LiveHandError

_TRIES = 5


@contextlib.contextmanager
def writable_folder(folder: Path) -> Iterator[int]:
    """Make the folder and check that it takes files; a new folder that stays empty is removed at the end.

    Yields:
        The time by the clock that dates the folder's files, ns.

    Raises:
        LiveHandError: it cannot be made or written to.
    """
    is_new = not folder.exists()
    try:
        now_ns = _made_ns(folder)
    except OSError as error:
        raise LiveHandError(
            f"the output folder {folder} must be writable ({error.strerror}); choose another"
        ) from error
    try:
        yield now_ns
    finally:
        if is_new:
            with contextlib.suppress(OSError):  # it holds frames, or another process uses it
                folder.rmdir()


def _made_ns(folder: Path, tries: int = _TRIES) -> int:
    """Make the folder, and a file in it: the file's time. Again if another process that ended meanwhile removed it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            return os.fstat(file.fileno()).st_mtime_ns
    except FileNotFoundError:
        if tries <= 1:
            raise
        return _made_ns(folder, tries - 1)


def not_written(path: Path, reason: str) -> LiveHandError:
    """Make the error for a file in such a folder that could not be saved."""
    return LiveHandError(f"{path} could not be written: {reason}; is the disk full? Run the same command again")


def folders_of(shots: Sequence[Path], output: Path) -> dict[Path, Path]:
    """Map each shot to its frames' folder: `output` itself for a single shot, otherwise a folder named after the shot.

    Raises:
        LiveHandError: two shots have the same name.
    """
    if len(shots) == 1:
        return {shots[0]: output}
    by_name: dict[str, Path] = {}
    for shot in shots:
        other = by_name.setdefault(shot.stem.casefold(), shot)
        if other is not shot:
            raise LiveHandError(
                f"shots must differ in name, each has a folder of its own; got {other} and {shot}; "
                "rename one, or render it into another folder"
            )
    return {shot: output / shot.stem for shot in shots}
