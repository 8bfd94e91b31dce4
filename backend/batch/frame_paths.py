"""The files of one frame: their names, their temporary names while they are written, and leftovers of killed runs."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .folders import not_written
from .frame_file import BrokenFrameError, check_frame, is_finished
from .frame_records import FrameRecord, read_records

FORMATS = ("exr", "png")
"""Of frames."""


@dataclass(frozen=True)
class FramePaths:
    """The paths of one frame: `wave_0001.exr` for `wave.blend`, and its sidecar `wave_0001.json`."""

    folder: Path
    stem: str
    frame: int

    def path(self, file_format: str) -> Path:
        """Return the path of the frame in one format, or of its sidecar (`json`)."""
        return self.folder / f"{self.stem}_{self.frame:04d}.{file_format}"

    def missing(self, formats: Sequence[str], size_px: tuple[int, int], since_ns: int) -> list[str]:
        """List the formats whose file is missing, does not decode, has another size, or is older than `since_ns`."""

        def is_there(path: Path) -> bool:
            return is_finished(path, size_px) and path.stat().st_mtime_ns >= since_ns

        return [name for name in formats if not is_there(self.path(name))]

    def exist(self, formats: Sequence[str]) -> bool:
        """Return whether the frame has a file in each of these formats; they are not read."""
        return all(self.path(name).is_file() for name in formats)

    def records(self, formats: Sequence[str]) -> list[FrameRecord]:
        """Read the records of the frame's files, of which those in these formats may exist."""
        present = [name for name in formats if self.path(name).is_file()]
        return read_records(self.path("json"), present)

    def remove_parts(self) -> None:
        """Remove every process's temporary files of this frame; only the holder of its lease may call this."""
        is_part = re.compile(rf"\.{re.escape(self.path('').name)}([0-9a-f]+\.)?part\.\w+")
        for path in self.folder.iterdir():
            if is_part.fullmatch(path.name):
                path.unlink(missing_ok=True)


class FrameParts:
    """A frame's files under temporary names: `.wave_0001.TOKEN.part.exr`.

    Leaving the context removes those that were not published.
    """

    def __init__(self, files: FramePaths, token: str):
        self._files, self._token = files, token
        self._paths: dict[Path, Path] = {}

    def __enter__(self) -> FrameParts:
        return self

    def __exit__(self, *_):
        for part in self._paths:
            part.unlink(missing_ok=True)

    def path(self, file_format: str) -> Path:
        """Return the absolute temporary path of a format; files are published in the order of these calls."""
        final = self._files.path(file_format)
        part = final.with_name(f".{final.stem}.{self._token}.part{final.suffix}").absolute()
        self._paths[part] = final
        return part

    def check(self, part: Path, size_px: tuple[int, int]) -> None:
        """Decode a saved file.

        Raises:
            LiveHandError: it is incomplete.
        """
        try:
            check_frame(part, size_px)
        except (OSError, BrokenFrameError) as error:
            raise not_written(self._paths[part], str(error)) from error

    def publish(self) -> None:
        """Rename every file to its final name.

        The images that they replace are removed first: whenever this ends, none lies beside another one's record.

        Raises:
            LiveHandError: one cannot be renamed.
        """
        for part, final in self._paths.items():
            with _named_in_errors(final):
                part.stat()  # all are there, or nothing is removed
        for final in self._paths.values():
            if final.suffix != ".json":
                with _named_in_errors(final):
                    final.unlink(missing_ok=True)
        for part, final in self._paths.items():
            with _named_in_errors(final):
                part.replace(final)


@contextlib.contextmanager
def _named_in_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise not_written(path, str(error.strerror)) from error


def frames_with_leftovers(folder: Path, stem: str) -> list[int]:
    """List frames of a shot that have leases or temporary files in the folder, of live or killed processes."""
    leftover = re.compile(rf"\.{re.escape(stem)}_(-?\d+)\.(claim(\.\d+)?|([0-9a-f]+\.)?part\.\w+)")
    matches = (leftover.fullmatch(path.name) for path in folder.iterdir())
    return sorted({int(match[1]) for match in matches if match})
