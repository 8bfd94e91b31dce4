"""Paths that files name: they stay in the folder of the file, so that what is shared holds nothing else."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

from ..records.errors import LiveHandError


def inner_path(folder: Path, name: object, follows_links: bool = False) -> Path:
    """The path of a name in a folder.

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
