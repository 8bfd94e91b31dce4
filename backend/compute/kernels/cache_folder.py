"""Where compiled kernels are kept: in the user's cache, else in a temporary folder of the user's own, else nowhere.

numba unpickles what lies there, which runs it. So nobody else may be able to write to the folder or to put another in
its place, wherever a variable or a home points: on farms that may be a folder of all users.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

_PREPARED = "prepared"  # a file beside the kernels, once all are there
_ROOM_BYTES = 1 << 25  # that all compiled kernels may take: numba fails where it cannot keep it
_ROOT = 0


def writable_cache(configured: str) -> Path | None:
    """Find the first of these folders that is the user's alone and takes files, as those of farms often do not.

    Args:
        configured: numba's own setting; empty if there is none.
    """
    found = (_private_folder(folder) for folder in _candidates(configured))
    return next((folder for folder in found if folder and _takes_files(folder)), None)


def kernel_folder_name() -> str:
    """Return the name of the folder of these kernels' machine code.

    numba checks only the file of the kernel itself, and would run old code when a kernel calls a changed one from
    another file, so the folder is named after the text of all kernels. It is also named after this package, because a
    cached signature refers to the classes of its named tuples by their module's name.
    """
    sources = sorted(Path(__file__).parent.glob("*.py"))
    text = b"".join(source.read_bytes() for source in sources)
    return f"kernels-{hashlib.sha256(str(__package__).encode() + text).hexdigest()[:16]}"


def is_prepared() -> bool:
    """Return whether a user's machine has all kernels compiled, which a file says; asks without numba."""
    return any((folder / _PREPARED).is_file() for folder in _kernel_folders())


def has_kernels() -> bool:
    """Return whether a user's machine has any kernels compiled; asks without numba."""
    return any(any(folder.glob("*/*.nbc")) for folder in _kernel_folders())


def _kernel_folders() -> list[Path]:
    name = kernel_folder_name()
    return [home / name for home in _candidates(os.environ.get("NUMBA_CACHE_DIR", ""))]


def mark_prepared(folder: Path) -> None:
    """Say that all kernels are compiled in their folder."""
    (folder / _PREPARED).touch()


def _candidates(configured: str) -> Iterator[Path]:
    with contextlib.suppress(RuntimeError):  # no home at all
        cache = Path(configured or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        yield cache / "livehand"
        yield cache / "livehand-kernels"  # where that one was made with room for a group
    with contextlib.suppress(OSError):  # no temporary folder
        yield Path(tempfile.gettempdir()) / f"livehand-{_user()}"


def _private_folder(folder: Path) -> Path | None:
    """Return the folder, made if missing, without links above it; None: others can write to it, or it is no folder."""
    try:
        folder = folder.parent.resolve() / folder.name
        for missing in reversed([one for one in (folder, *folder.parents) if not one.exists()]):
            missing.mkdir(mode=0o700, exist_ok=True)
        info = folder.lstat()
        if not stat.S_ISDIR(info.st_mode):
            return None
        if not hasattr(os, "getuid"):  # Windows, where these folders lie in the user's profile
            return folder
        is_private = info.st_uid == _user() and not _is_open(info)
        return folder if is_private and all(_is_safe_above(parent.stat()) for parent in folder.parents) else None
    except (OSError, ValueError):
        return None


def _is_safe_above(info: os.stat_result) -> bool:
    """Return whether others cannot replace what lies in a folder; temporary folders have a bit that forbids it."""
    return info.st_uid in (_ROOT, _user()) and (not _is_open(info) or bool(info.st_mode & stat.S_ISVTX))


def _is_open(info: os.stat_result) -> bool:
    """Return whether others can write, or a group that is not the user's own one."""
    return bool(info.st_mode & stat.S_IWOTH) or bool(info.st_mode & stat.S_IWGRP and not _is_own_group(info.st_gid))


def _is_own_group(group: int) -> bool:
    """Return whether the group is named after the user and has no other member, as Linux distributions make one."""
    import grp
    import pwd

    try:
        name, members = pwd.getpwuid(_user()).pw_name, grp.getgrgid(group).gr_mem
        return grp.getgrgid(group).gr_name == name and set(members) <= {name}
    except KeyError:
        return False


def _user() -> int:
    """Return the user's number; Windows has none."""
    return os.getuid() if hasattr(os, "getuid") else 0


def _takes_files(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_ROOM_BYTES))
        return True
    except OSError:
        return False
