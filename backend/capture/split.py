"""The held-out frames and cameras of a capture, and the file that publishes them.

A held-out frame (pose) is not trained on from any camera, and a held-out camera is not trained on in any frame.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.readers import read_json
from .capture import Split

FORMAT = "livehand-split"
VERSION = 1
HELD_OUT_FRAMES = 50
"""Number of held-out frames, the last of a capture (paper, section 4)."""
CAMERA_STEP, CAMERA_OFFSET = 10, 4
"""Of the sorted ids of a capture's colour cameras, every tenth from the fifth is held out."""


@dataclass(frozen=True)
class FrameSplit:
    """The training and held-out frames and cameras.

    Attributes:
        source: name of the data, such as `InterHand2.6M test/Capture0 right`.
        train_frames: frame numbers, in order.
        held_out_frames: frame numbers, in order.
        train_cameras: camera ids.
        held_out_cameras: camera ids.
    """

    source: str
    train_frames: tuple[int, ...]
    held_out_frames: tuple[int, ...]
    train_cameras: tuple[str, ...]
    held_out_cameras: tuple[str, ...]

    @property
    def frames(self) -> tuple[int, ...]:
        """All frames, in order."""
        return tuple(sorted(self.train_frames + self.held_out_frames))

    @property
    def cameras(self) -> tuple[str, ...]:
        """All cameras, in order."""
        return tuple(sorted(self.train_cameras + self.held_out_cameras))

    def of(self, frame: int, camera: str) -> Split:
        """Assign an image to its split."""
        return split_of(frame in self.held_out_frames, camera in self.held_out_cameras)


def split_of(is_pose_held_out: bool, is_camera_held_out: bool) -> Split:
    """Name the split of an image."""
    if is_camera_held_out:
        return "test" if is_pose_held_out else "novel_camera"
    return "novel_pose" if is_pose_held_out else "train"


def default_split(
    source: str, frames: list[int], cameras: list[str], last: int, held_out: list[str] | None
) -> FrameSplit:
    """Make the split that holds out the last frames, and the given cameras or every tenth.

    Raises:
        LiveHandError: nothing is left to train on, or a given camera does not exist.
    """
    frames, cameras = sorted(frames), sorted(cameras)
    chosen = cameras[CAMERA_OFFSET::CAMERA_STEP] if held_out is None else held_out
    unknown = sorted(set(chosen) - set(cameras))
    if unknown:
        raise LiveHandError(f"held-out cameras must be among {source}'s {len(cameras)}, got {unknown}")
    first_held_out = max(0, len(frames) - last)
    rest = tuple(camera for camera in cameras if camera not in chosen)
    if not first_held_out or not rest:
        raise LiveHandError(
            f"{source} must leave frames and cameras to train on, "
            f"got {last} of {len(frames)} frames and {len(chosen)} of {len(cameras)} cameras held out; hold out fewer"
        )
    return FrameSplit(source, tuple(frames[:first_held_out]), tuple(frames[first_held_out:]), rest, tuple(chosen))


def every(split: FrameSplit, step: int) -> FrameSplit:
    """Thin the split to each `step`-th of its training and held-out frames."""
    return replace(split, train_frames=split.train_frames[::step], held_out_frames=split.held_out_frames[::step])


def split_document(split: FrameSplit) -> str:
    """Write out a split file as text."""
    return json.dumps({"format": FORMAT, "version": VERSION, **asdict(split)}, indent=1) + "\n"


def load_split(path: Path, source: str) -> FrameSplit:
    """Read a split file.

    Raises:
        LiveHandError: unreadable, malformed, of another source, or with something in both training and held-out sets.
    """
    try:
        document = read_json(path)
        if (document["format"], document["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format {document['format']} {document['version']}, must be {FORMAT} {VERSION}")
        split = _from_document(document)
    except (LiveHandError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise LiveHandError(f"{path} must be a split file ({type(error).__name__}: {error})") from error
    if split.source != source:
        raise LiveHandError(f"{path} must be of {source}, got one of {split.source}")
    both = {*split.train_frames} & {*split.held_out_frames}, {*split.train_cameras} & {*split.held_out_cameras}
    if any(both):
        raise LiveHandError(
            f"{path}: held-out frames and cameras must not be trained on, got {sorted(map(str, both[0] | both[1]))[:5]}"
        )
    return split


def _from_document(document: dict[str, Any]) -> FrameSplit:
    return FrameSplit(
        str(document["source"]),
        tuple(int(frame) for frame in document["train_frames"]),
        tuple(int(frame) for frame in document["held_out_frames"]),
        tuple(str(camera) for camera in document["train_cameras"]),
        tuple(str(camera) for camera in document["held_out_cameras"]),
    )
