"""The tracker's two networks in the user's data folder. They are MediaPipe's, under Apache-2.0, and are never shipped.

The user runs `livehand fetch-tracker` once. What is taken out of the wheel is held to its sha256, then and whenever it
is read.
"""

from __future__ import annotations

import hashlib
import io
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from ..records.errors import LiveHandError
from ..system.files import MIB, data_folder, is_file, read_regular, replacing
from .tflite import Network, read_network

FETCH_COMMAND = "livehand fetch-tracker"
_WHEEL = "mediapipe==0.10.21"
# One wheel for every system: nothing of it is run.
_PLATFORM = (
    "--python-version",
    "3.11",
    "--implementation",
    "cp",
    "--abi",
    "cp311",
    "--platform",
    "manylinux_2_28_x86_64",
)
_FETCH_SECONDS = 900
_MOST_WHEEL_BYTES, _MOST_MEMBER_BYTES = 256 * MIB, 16 * MIB
_LICENCE, _LICENCE_IN_WHEEL = "LICENSE", "mediapipe-0.10.21.dist-info/LICENSE"
_LICENCE_NOTE = "The networks in this folder are MediaPipe's, under the Apache License, version 2.0.\n"


@dataclass(frozen=True)
class _Part:
    """A network: its name here, its names in a wheel and in a `hand_landmarker.task`, and the sha256 of both."""

    name: str
    members: tuple[str, str]
    sha256: tuple[str, str]


_PARTS = (
    _Part(
        "palm.tflite",
        ("mediapipe/modules/palm_detection/palm_detection_full.tflite", "hand_detector.tflite"),
        (
            "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
            "945f713bc23570bd4ed60f848c401dc8eaf95713183d43ba14cf12e467d27a7d",
        ),
    ),
    _Part(
        "hand.tflite",
        ("mediapipe/modules/hand_landmark/hand_landmark_full.tflite", "hand_landmarks_detector.tflite"),
        (
            "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
            "6acda74af3fbf40e68265c20c7394b2bad81a16a481dcd79ad7a081887c3d6b9",
        ),
    ),
)


@dataclass(frozen=True)
class TrackerNetworks:
    """The palm detector and the hand's landmark network."""

    palm: Network
    hand: Network


def tracker_folder() -> Path:
    """Return the folder of the networks: `livehand/tracker` in the user's data folder.

    Raises:
        LiveHandError: the user has no home.
    """
    try:
        return data_folder() / "livehand" / "tracker"
    except RuntimeError as error:
        raise LiveHandError("a home folder must be known to keep the tracker, got none; set XDG_DATA_HOME") from error


def has_networks(folder: Path | None = None) -> bool:
    """Return whether the networks have been fetched; they are not read."""
    folder = folder or tracker_folder()
    return all(is_file(folder / part.name) for part in _PARTS)


def load_networks(folder: Path | None = None) -> TrackerNetworks:
    """Load the networks from a folder (None: the user's).

    Raises:
        LiveHandError: they have not been fetched, or are not the pinned ones.
    """
    folder = folder or tracker_folder()
    if not has_networks(folder):
        raise LiveHandError(f"the hand tracker's networks must be in {folder}, got none; fetch them: {FETCH_COMMAND}")
    return TrackerNetworks(*(read_network(_checked(part, _read(folder / part.name))) for part in _PARTS))


def fetch_networks(folder: Path | None = None) -> Path:
    """Have pip download the pinned wheel, and take the networks out of it; returns their folder.

    Raises:
        LiveHandError: pip cannot download it, or it is another one.
    """
    with tempfile.TemporaryDirectory() as downloads:
        options = ["--no-deps", "--only-binary=:all:", *_PLATFORM, "--dest", downloads]
        pip = [sys.executable, "-P", "-m", "pip"]  # -P: a pip.py in the current folder is not run
        command = [*pip, "download", "--disable-pip-version-check", "--quiet", *options, _WHEEL]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_FETCH_SECONDS, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise LiveHandError(f"pip must download {_WHEEL}, got {type(error).__name__}; {_REMEDY}") from error
        wheels = list(Path(downloads).glob("*.whl"))
        if done.returncode or len(wheels) != 1:
            reason = (done.stderr.strip().splitlines() or ["nothing"])[-1]
            raise LiveHandError(f"pip must download {_WHEEL}, got: {reason}; {_REMEDY}")
        return take_networks(wheels[0], folder)


_REMEDY = f"try again, or download the wheel elsewhere and run: {FETCH_COMMAND} --weights FILE"


def take_networks(path: Path, folder: Path | None = None) -> Path:
    """Take the networks out of a wheel or a `hand_landmarker.task`, with their licence; returns their folder.

    Raises:
        LiveHandError: the file is neither, is damaged, or holds other networks. Nothing is written then.
    """
    folder = folder or tracker_folder()
    try:
        with zipfile.ZipFile(io.BytesIO(read_regular(path, _MOST_WHEEL_BYTES))) as archive:
            found = {part.name: _checked(part, _member(archive, *part.members)) for part in _PARTS}
            is_wheel = _LICENCE_IN_WHEEL in archive.namelist()
            found[_LICENCE] = _member(archive, _LICENCE_IN_WHEEL) if is_wheel else _LICENCE_NOTE.encode()
    except LiveHandError as error:
        raise error if str(path) in str(error) else LiveHandError(f"{path}: {error}") from error
    except Exception as error:  # a damaged archive can raise nearly anything
        raise LiveHandError(
            f"{path} must be the wheel of {_WHEEL} or a hand_landmarker.task, got {type(error).__name__}: "
            f"{str(error)[:200]}; fetch it: {FETCH_COMMAND}"
        ) from error
    for name, content in found.items():
        with replacing(folder / name) as temporary:
            temporary.write_bytes(content)
    return folder


def _read(path: Path) -> bytes:
    return read_regular(path, _MOST_MEMBER_BYTES)


def _member(archive: zipfile.ZipFile, *names: str) -> bytes:
    """Read the first of the members that the archive has."""
    name = next((name for name in names if name in archive.namelist()), None)
    if name is None:
        raise LiveHandError(f"the archive must hold {' or '.join(names)}, got neither; fetch it: {FETCH_COMMAND}")
    if archive.getinfo(name).file_size > _MOST_MEMBER_BYTES:
        raise LiveHandError(f"{name} must hold at most {_MOST_MEMBER_BYTES // MIB} MiB; fetch it: {FETCH_COMMAND}")
    return archive.read(name)


def _checked(part: _Part, content: bytes) -> bytes:
    """Check the content and return it.

    Raises:
        LiveHandError: it is not one of the pinned networks.
    """
    sha256 = hashlib.sha256(content).hexdigest()
    if sha256 not in part.sha256:
        raise LiveHandError(
            f"{part.name} must be the pinned network of {_WHEEL} (sha256 {part.sha256[0][:12]}...), got "
            f"{sha256[:12]}...; fetch it: {FETCH_COMMAND}"
        )
    return content
