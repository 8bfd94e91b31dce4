"""The tracker's two networks in the user's data folder. They are MediaPipe's, under Apache-2.0, and are never shipped.

The user runs `livehand fetch-tracker` once. What is taken out of the wheel is held to its sha256, then and whenever it
is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..records.errors import LiveHandError
from ..system.files import MIB, is_file, read_regular, replacing
from ..system.package_files import Package, PackageFile, checked, user_folder
from .tflite import Network, read_network

FETCH_COMMAND = "livehand fetch-tracker"
_PALM = PackageFile(
    "palm.tflite",
    ("mediapipe/modules/palm_detection/palm_detection_full.tflite", "hand_detector.tflite"),
    (
        "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
        "945f713bc23570bd4ed60f848c401dc8eaf95713183d43ba14cf12e467d27a7d",
    ),
)
_HAND = PackageFile(
    "hand.tflite",
    ("mediapipe/modules/hand_landmark/hand_landmark_full.tflite", "hand_landmarks_detector.tflite"),
    (
        "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
        "6acda74af3fbf40e68265c20c7394b2bad81a16a481dcd79ad7a081887c3d6b9",
    ),
)
# One wheel for every system: nothing of it is run.
_ONE_WHEEL = ("--only-binary=:all:", "--python-version", "3.11", "--implementation", "cp", "--abi", "cp311")
PACKAGE = Package(
    requirement="mediapipe==0.10.21",
    sha256="05dc4a9e593655a79558d05d6227d31018c2537a4bd3362b51e230cf22aecfe3",
    options=(*_ONE_WHEEL, "--platform", "manylinux_2_28_x86_64"),
    files=(_PALM, _HAND),
    most_bytes=16 * MIB,
    content="the hand tracker's networks, with their licence",
    archives="the wheel of mediapipe==0.10.21 or a hand_landmarker.task",
    licence="The networks in this folder are MediaPipe's, under the Apache License, version 2.0.",
    licence_member="mediapipe-0.10.21.dist-info/LICENSE",
    fetch_command=FETCH_COMMAND,
    megabytes=36,
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
    return user_folder("tracker")


def has_networks(folder: Path | None = None) -> bool:
    """Return whether the networks have been fetched; they are not read."""
    folder = folder or tracker_folder()
    return all(is_file(folder / file.name) for file in PACKAGE.files)


def load_networks(folder: Path | None = None) -> TrackerNetworks:
    """Load the networks from a folder (None: the user's).

    Raises:
        LiveHandError: they have not been fetched, or are not the pinned ones.
    """
    folder = folder or tracker_folder()
    if not has_networks(folder):
        raise LiveHandError(f"the hand tracker's networks must be in {folder}, got none; fetch them: {FETCH_COMMAND}")
    contents = [(file.name, read_regular(folder / file.name, PACKAGE.most_bytes)) for file in PACKAGE.files]
    return TrackerNetworks(*(read_network(checked(PACKAGE, name, content)) for name, content in contents))


def keep_networks(found: Mapping[str, bytes], folder: Path | None = None) -> Path:
    """Write what was taken out of the package into a folder (None: the user's); returns it."""
    folder = folder or tracker_folder()
    for name, content in found.items():
        with replacing(folder / name) as temporary:
            temporary.write_bytes(content)
    load_networks(folder)
    return folder
