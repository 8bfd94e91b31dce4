"""Packages that pip installs into a folder of LiveHand's own, while Blender goes on.

They come into a folder beside it first and are moved at the end, so that what is half installed is never found. numpy
is held at the version in use and is not kept: Blender brings its own, which its other add-ons use too.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path, PurePath
from typing import TypeVar

from ..records.errors import LiveHandError
from .files import MIB
from .packages import Requirement, pip_requirements, wheel_here
from .processes import is_running

_AnyPath = TypeVar("_AnyPath", bound=PurePath)
_END_S = 2.0
_CUDA_MB = 2700  # torch for Linux from the usual index
_SHARE_OF_LINUX = {"win32": 0.65, "darwin": 0.6}  # sizes of downloads
_ROOM = 5  # on the disk, times the download: archives, unpacked files, both for a moment
_DOWNLOADING = 0.8  # of the progress; the rest is unpacking
_KEPT_BY_BLENDER = re.compile(r"numpy([.-].*)?|bin|__pycache__", re.IGNORECASE)
_LEFTOVER = re.compile(r"\w+~(\d+)(?:-.*)?")


def download_mb(requirements: Iterable[Requirement], index: str) -> int:
    """Return about how many megabytes pip downloads for this system; `index` is PyTorch's for CPUs, or empty."""
    wanted = tuple(requirements)
    has_cuda = sys.platform == "linux" and not index and any(one.module == "torch" for one in wanted)
    ours = sum(one.megabytes for one in wanted if not one.wheels) * _SHARE_OF_LINUX.get(sys.platform, 1.0)
    pinned = sum(wheel.megabytes for wheel in map(wheel_here, wanted) if wheel)
    return round(ours) + pinned + (_CUDA_MB if has_cuda else 0)


def pip_program() -> list[str]:
    """Return the command that runs pip by this Python: its own, or the one that Python keeps for installing pip.

    A `pip.py` in the current folder is not run (-P).

    Raises:
        LiveHandError: this Python has no pip at all.
    """
    python = [sys.executable, "-P"]
    if importlib.util.find_spec("pip") is not None:
        return [*python, "-m", "pip"]
    found = importlib.util.find_spec("ensurepip")
    wheels = sorted(Path(str(found.origin)).parent.glob("_bundled/pip-*.whl")) if found and found.origin else []
    if not wheels:
        raise LiveHandError("Blender's Python must have pip, got none; install the zip with all packages instead")
    start = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('pip', run_name='__main__')"
    return [*python, "-c", start, str(wheels[-1])]


def install_command(requirements: Iterable[Requirement], target: Path | None = None, index: str = "") -> list[str]:
    """Return the command that installs packages for this Python, as a program and its arguments.

    Args:
        requirements: what to install.
        target: the folder to install into; None: this Python's own.
        index: the address of PyTorch's index for CPUs; empty: pip's own index alone.
    """
    where = ["--target", str(target)] if target else []
    where += ["--extra-index-url", index] if index else []
    wanted = pip_requirements(requirements, has_cpu_index=bool(index))
    return [*pip_program(), "install", *where, *wanted, f"numpy=={metadata.version('numpy')}"]


@dataclass
class PipJob:
    """A running pip: what it says, and how much it has downloaded.

    Attributes:
        temporary: the folder of its downloads, removed at the end.
    """

    temporary: Path
    _process: subprocess.Popen[str]
    _lines: list[str] = field(default_factory=list[str])
    _code: int | None = None

    def __post_init__(self):
        self._reader = threading.Thread(target=self._read, name="livehand pip", daemon=True)

    @classmethod
    def start(cls, arguments: Sequence[str], temporary: Path) -> PipJob:
        """Start pip with these arguments, without a terminal.

        Raises:
            LiveHandError: this Python has no pip, or cannot be started.
        """
        temporary.mkdir(parents=True, exist_ok=True)
        for_files = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))
        settings = {"PIP_USER": "0", "PIP_REQUIRE_VIRTUALENV": "0", "PIP_NO_INPUT": "1", "PIP_NO_COLOR": "1"}
        text = {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
        try:
            process = subprocess.Popen(
                [*pip_program(), *arguments],
                env=os.environ | for_files | settings | text,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise LiveHandError(f"Blender's Python must run pip ({error}); repair Blender's installation") from error
        job = cls(temporary, process)
        job._reader.start()
        return job

    @property
    def last_line(self) -> str:
        """What pip does now."""
        return self._lines[-1] if self._lines else "Starting pip"

    @property
    def is_running(self) -> bool:
        """Whether pip has not ended yet."""
        return self._code is None

    @property
    def is_unpacking(self) -> bool:
        """Whether all is downloaded."""
        return any(line.startswith("Installing collected packages") for line in self._lines)

    def downloaded_mb(self) -> float:
        """Return the size of what lies in the temporary folder, MB."""
        total = 0
        for folder, _, names in os.walk(self.temporary):
            for name in names:
                with contextlib.suppress(OSError):  # pip removes files meanwhile
                    total += os.stat(os.path.join(folder, name)).st_size
        return total / MIB

    def wait(self) -> None:
        """Wait for the end."""
        self._reader.join()

    def check(self, what: str) -> None:
        """Check that pip has succeeded.

        Raises:
            LiveHandError: it has not; `what` is what it should have done.
        """
        if self._code:
            errors = [line for line in self._lines if line.startswith("ERROR: ")]
            reason = (errors or self._lines or ["nothing"])[0].removeprefix("ERROR: ")
            raise LiveHandError(f"pip must {what}, got: {reason}; check the connection and Package Index, try again")

    def cancel(self) -> None:
        """End pip at once and remove what it has downloaded."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._reader.join()
        self.clear()

    def clear(self) -> None:
        """Remove what it has downloaded."""
        shutil.rmtree(self.temporary, ignore_errors=True)

    def _read(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        with pipe:
            for line in pipe:
                if line.strip() and not line.startswith(("WARNING: ", "[notice]")):
                    self._lines.append(line.strip())
        self._code = self._process.wait()


@dataclass
class PackageInstall:
    """Packages on their way into a folder.

    Attributes:
        folder: that they come into.
        job: the pip that brings them.
    """

    folder: Path
    job: PipJob
    _expected_mb: int
    _seen: float = 0.0

    @classmethod
    def start(cls, requirements: Sequence[Requirement], folder: Path, index: str = "") -> PackageInstall:
        """Start to install; packages that lie in the folder already keep their versions.

        Packages are either all pinned by the hashes of their files, or none is.

        Raises:
            LiveHandError: the disk has no room, the folder cannot be made, or this Python has no pip.
        """
        expected_mb = download_mb(requirements, index)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _remove_leftovers(folder.parent)
            free_mb = shutil.disk_usage(folder).free / MIB
            temporary = _temporary_folder(folder)
            wanted = _wanted(requirements, folder, temporary, index)
        except OSError as error:
            raise LiveHandError(f"{folder} must be writable ({error}); make room, or change its permissions") from error
        needed_mb = _ROOM * expected_mb
        if free_mb < needed_mb:
            shutil.rmtree(temporary, ignore_errors=True)
            raise LiveHandError(f"{folder} must have {needed_mb:,} MB of free space, got {free_mb:,.0f}; make room")
        options = ["--only-binary=:all:", "--no-compile", "--no-warn-conflicts", "--progress-bar=off"]
        return cls(folder, PipJob.start(["install", *options, *wanted], temporary), expected_mb)

    def progress(self) -> float:
        """Return how much is done, 0 to 1, by the megabytes that lie there; it never goes back."""
        if self.job.is_unpacking:
            self._seen = max(self._seen, _DOWNLOADING)
        else:
            done = self.job.downloaded_mb() / max(self._expected_mb, 1)
            self._seen = max(self._seen, _DOWNLOADING * min(done, 1.0))
        return self._seen

    def finish(self) -> None:
        """Move what was installed into the folder, after pip's end, and let Python find it.

        Raises:
            LiveHandError: pip has failed, or the folder cannot be written.
        """
        try:
            self.job.check("install the packages")
            for entry in sorted(_unfinished(self.folder).iterdir()):
                kept = self.folder / entry.name
                if not _KEPT_BY_BLENDER.fullmatch(entry.name) and not kept.exists():
                    os.replace(entry, kept)
        except OSError as error:
            raise LiveHandError(f"{self.folder} must be writable ({error}); close other Blenders, try again") from error
        finally:
            self.job.clear()
            _remove_unfinished(self.folder)
        importlib.invalidate_caches()

    def cancel(self) -> None:
        """End it; the folder is as before."""
        self.job.cancel()
        _remove_unfinished(self.folder)


def _wanted(requirements: Sequence[Requirement], folder: Path, temporary: Path, index: str) -> list[str]:
    """Return pip's arguments that say what is installed beside the folder, and write the files that they name."""
    if any(one.wheels for one in requirements):
        pinned = temporary / "pinned.txt"
        pinned.write_text("\n".join(map(_pinned_line, requirements)), encoding="utf-8")
        by_hash = ["--no-deps", "--require-hashes", "--requirement", str(pinned)]
        return ["--target", str(_unfinished(folder)), *by_hash]
    held = temporary / "held.txt"
    held.write_text("\n".join(_held_versions(folder)), encoding="utf-8")
    command = install_command(requirements, _unfinished(folder), index)
    return [*command[command.index("install") + 1 :], "--constraint", str(held)]


def _pinned_line(requirement: Requirement) -> str:
    return " ".join([requirement.pip, *(f"--hash=sha256:{wheel.sha256}" for wheel in requirement.wheels)])


def _unfinished(folder: _AnyPath) -> _AnyPath:
    """Return where the packages wait; the name is short, as Windows takes paths of 259 characters."""
    return folder.with_name(f"{folder.name}~{os.getpid()}")


def _remove_unfinished(folder: Path) -> None:
    shutil.rmtree(_unfinished(folder), ignore_errors=True)


def _temporary_folder(folder: Path) -> Path:
    """Make the folder of downloads: beside the packages, as others may be small; in Windows in the shortest place."""
    beside = None if os.name == "nt" else folder.parent
    return Path(tempfile.mkdtemp(prefix=f"livehand~{os.getpid()}-", dir=beside))


def _remove_leftovers(parent: Path) -> None:
    """Remove what installs of processes have left that ended before."""
    for entry in parent.iterdir():
        owner = _LEFTOVER.fullmatch(entry.name)
        if owner and not is_running(int(owner[1])):
            shutil.rmtree(entry, ignore_errors=True)


def _held_versions(folder: Path) -> list[str]:
    """List the packages of the folder with their versions, as pip's constraints."""
    found = metadata.distributions(path=[str(folder)])
    return sorted(f"{one.metadata['Name']}=={one.version}" for one in found)
