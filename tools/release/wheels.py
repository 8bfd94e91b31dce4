"""Wheels of a target, chosen by pip's own resolution as that system would answer, and what they say of themselves."""

from __future__ import annotations

import email.message
import email.parser
import json
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from packaging.requirements import Requirement
from packaging.tags import Tag
from packaging.utils import canonicalize_name, parse_wheel_filename
from packaging.version import Version

from ...backend.records.errors import LiveHandError
from ...backend.system.packages import REQUIREMENTS, pip_requirements
from .targets import Target

_FOREIGN_PIP = Path(__file__).with_name("foreign_pip_command.py")
_DOWNLOAD_SECONDS = 3600
_LICENCE = re.compile(
    r"[^/]*\.dist-info/(?:.*/)?[^/]*(?:licen[cs]e|copying|notice|copyright|authors)[^/]*", re.IGNORECASE
)


@dataclass(frozen=True)
class Wheel:
    """A wheel's file, read without unpacking it."""

    path: Path

    @property
    def name(self) -> str:
        """The package's name, spelled as pip compares names."""
        return parse_wheel_filename(self.path.name)[0]

    @property
    def version(self) -> Version:
        """The package's version."""
        return parse_wheel_filename(self.path.name)[1]

    @property
    def tags(self) -> frozenset[Tag]:
        """The Pythons and systems that it is for."""
        return parse_wheel_filename(self.path.name)[3]

    @cached_property
    def members(self) -> tuple[str, ...]:
        """The names of its files."""
        with zipfile.ZipFile(self.path) as archive:
            return tuple(name for name in archive.namelist() if not name.endswith("/"))

    @cached_property
    def metadata(self) -> email.message.Message:
        """Its METADATA."""
        with zipfile.ZipFile(self.path) as archive:
            (name,) = (one for one in self.members if re.fullmatch(r"[^/]+\.dist-info/METADATA", one))
            return email.parser.Parser().parsestr(archive.read(name).decode("utf-8"))

    def needs(self, markers: Mapping[str, str]) -> list[Requirement]:
        """List the packages that it needs on a system that answers so; none of its extras."""
        needed = map(Requirement, self.metadata.get_all("Requires-Dist") or ())
        answers = {**markers, "extra": ""}
        return [one for one in needed if one.marker is None or one.marker.evaluate(answers)]

    @property
    def import_names(self) -> set[str]:
        """The modules and packages that it puts at the top of Python's path."""
        inner = (re.sub(r"^[^/]+\.data/(?:pure|plat)lib/", "", member) for member in self.members)
        tops = (name.split("/", 1) for name in inner if ".dist-info/" not in name and ".data/" not in name)
        return {parts[0].partition(".")[0] for parts in tops}

    @property
    def licence(self) -> str:
        """Its licence in a line, as it calls it; empty: its texts alone tell."""
        found = self.metadata.get("License-Expression") or self.metadata.get("License") or ""
        kinds = [line for line in self.metadata.get_all("Classifier") or () if line.startswith("License ::")]
        return found.strip().partition("\n")[0] or "; ".join(kind.rpartition(" :: ")[2] for kind in kinds)

    @property
    def licence_files(self) -> list[str]:
        """The names of the licences' texts in it."""
        return sorted(filter(_LICENCE.fullmatch, self.members))

    def licence_text(self) -> str:
        """Return its name, its licence, and the texts of the licences in it."""
        texts = [f"{self.metadata['Name']} {self.version}\nLicense: {self.licence or 'see below'}\n"]
        with zipfile.ZipFile(self.path) as archive:
            for name in self.licence_files:
                texts.append(f"{name.partition('/')[2]}\n\n{archive.read(name).decode('utf-8', errors='replace')}")
        return f"\n{'-' * 80}\n".join(texts)


def collect_wheels(target: Target, folder: Path, options: Sequence[str] = ()) -> list[Wheel]:
    """Download the wheels of a target into an empty folder; numpy is left out, as Blender brings it.

    Args:
        target: the system and its Python.
        folder: for the wheels; made if missing.
        options: more of pip's, such as an index.

    Raises:
        LiveHandError: pip finds no set of wheels for that system.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = pip_requirements(REQUIREMENTS, target.markers["sys_platform"])
    where = [f"--platform={tag}" for tag in target.system.wheel_platforms]
    where += ["--only-binary=:all:", "--implementation=cp", f"--python-version={target.python}"]
    with tempfile.TemporaryDirectory() as temporary:
        constraints = Path(temporary) / "constraints.txt"
        constraints.write_text(f"numpy=={target.numpy[0]}\n", encoding="utf-8")
        common = ["--disable-pip-version-check", "--no-input", f"--constraint={constraints}", f"--dest={folder}"]
        pip = [sys.executable, str(_FOREIGN_PIP), json.dumps(target.markers), "download"]
        done = subprocess.run(
            [*pip, *common, *where, *options, *wanted],
            capture_output=True,
            text=True,
            timeout=_DOWNLOAD_SECONDS,
            check=False,
        )
    if done.returncode:
        reason = next(
            (line for line in done.stderr.splitlines() if line.startswith("ERROR: ")), done.stderr.strip()[-300:]
        )
        raise LiveHandError(f"{target.name}: pip must find a wheel of every package, got: {reason}")
    wheels = [Wheel(path) for path in sorted(folder.glob("*.whl"))]
    return [wheel for wheel in wheels if wheel.name != "numpy"]


def unmet_requirements(wheels: Sequence[Wheel], target: Target) -> list[str]:
    """List what the wheels need on their system and neither they nor Blender's numpy are."""
    versions: dict[str, tuple[Version, ...]] = {wheel.name: (wheel.version,) for wheel in wheels}
    versions["numpy"] = tuple(map(Version, target.numpy))
    unmet = []
    asked = [("livehand", Requirement(one)) for one in pip_requirements(REQUIREMENTS, target.markers["sys_platform"])]
    asked += [(wheel.name, one) for wheel in wheels for one in wheel.needs(target.markers)]
    for name, needed in asked:
        found = versions.get(canonicalize_name(needed.name), ())
        missed = [str(one) for one in found if not needed.specifier.contains(one, prereleases=True)]
        if missed or not found:
            unmet.append(f"{name} needs {needed.name}{needed.specifier}, got {', '.join(missed) or 'none'}")
    return unmet


def fits(wheel: Wheel, target: Target) -> bool:
    """Return whether a wheel runs on a target's system and Python."""
    python = target.python.replace(".", "")
    platforms = {"any", *target.system.wheel_platforms}
    for tag in wheel.tags:
        is_python = tag.interpreter in (f"cp{python}", "py3", f"py{python}") or tag.abi == "abi3"
        is_system = tag.platform in platforms or _is_older_macos(tag.platform, target)
        if is_python and is_system and tag.abi in ("none", "abi3", f"cp{python}"):
            return True
    return False


def _is_older_macos(platform: str, target: Target) -> bool:
    """Return whether a tag is that of an earlier macOS than the target's, on its processor."""
    pattern = r"macosx_(\d+)_\d+_(arm64|universal2)"
    found, ours = re.fullmatch(pattern, platform), re.fullmatch(pattern, target.system.wheel_platforms[0])
    return bool(found and ours and int(found[1]) <= int(ours[1]))
