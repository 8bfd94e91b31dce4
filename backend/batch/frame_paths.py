"""The files of one frame: their names, the temporary names they are made under, and what a kill left of them."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..records.errors import LiveHandError
from .frame_file import BrokenFrameError, check_frame, is_finished


@dataclass(frozen=True)
class FramePaths:
    """Where one frame of `wave.blend` lies: `wave_0001.exr` and, beside it, `wave_0001.json`."""

    folder: Path
    stem: str
    frame: int

    def path(self, file_format: str) -> Path:
        """Of the frame in one format, or of its sidecar (`json`)."""
        return self.folder / f"{self.stem}_{self.frame:04d}.{file_format}"

    def missing(self, formats: Sequence[str], size_px: tuple[int, int], since_ns: int) -> list[str]:
        """The formats that are not there, do not decode, are of another size, or older than `since_ns`."""
        return [name for name in formats if not self._is_there(self.path(name), size_px, since_ns)]

    def remove_parts(self) -> None:
        """Remove everyone's temporary files of this frame; only who has claimed it may ask."""
        is_part = re.compile(rf"\.{re.escape(self.path('').name)}([0-9a-f]+\.)?part\.\w+")
        for path in self.folder.iterdir():
            if is_part.fullmatch(path.name):
                path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def parts(self, token: str) -> Iterator[FrameParts]:
        """Temporary files for this frame; those that were not published are removed at the end."""
        parts = FrameParts(self, token)
        try:
            yield parts
        finally:
            parts.remove()

    @staticmethod
    def _is_there(path: Path, size_px: tuple[int, int], since_ns: int) -> bool:
        return is_finished(path, size_px) and path.stat().st_mtime_ns >= since_ns


class FrameParts:
    """A frame's files under temporary names: `.wave_0001.TOKEN.part.exr`."""

    def __init__(self, files: FramePaths, token: str):
        self._files, self._token = files, token
        self._paths: dict[Path, Path] = {}

    def path(self, file_format: str) -> Path:
        """The absolute temporary path to save a format under; files are published in the order of these calls."""
        final = self._files.path(file_format)
        part = final.with_name(f".{final.stem}.{self._token}.part{final.suffix}").absolute()
        self._paths[part] = final
        return part

    def check(self, part: Path, size_px: tuple[int, int]) -> None:
        """Decode what was saved.

        Raises:
            LiveHandError: it is not whole.
        """
        try:
            check_frame(part, size_px)
        except (OSError, BrokenFrameError) as error:
            raise not_written(self._paths[part], str(error)) from error

    def publish(self) -> None:
        """Give every file its name.

        Raises:
            LiveHandError: one cannot be renamed.
        """
        for part, final in self._paths.items():
            try:
                part.replace(final)
            except OSError as error:
                raise not_written(final, str(error.strerror)) from error

    def remove(self) -> None:
        """Remove what was not published."""
        for part in self._paths:
            part.unlink(missing_ok=True)


def frames_with_leftovers(folder: Path, stem: str) -> list[int]:
    """Frames of a shot that have claims or temporary files in the folder, of live processes or killed ones."""
    leftover = re.compile(rf"\.{re.escape(stem)}_(-?\d+)\.(claim(\.\d+)?|([0-9a-f]+\.)?part\.\w+)")
    matches = (leftover.fullmatch(path.name) for path in folder.iterdir())
    return sorted({int(match[1]) for match in matches if match})


def not_written(path: Path, reason: str) -> LiveHandError:
    """The error of a file that could not be saved."""
    return LiveHandError(f"{path} could not be written: {reason}; is the disk full?")
