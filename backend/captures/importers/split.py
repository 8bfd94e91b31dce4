"""Which frames and cameras of a capture are held out, and the file that publishes it.

Held out means never seen in training: a frame (a pose) whatever camera took it, a camera whatever it took.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...records.errors import LiveHandError
from ..capture import Split

FORMAT = "livehand-split"
VERSION = 1
HELD_OUT_FRAMES = 50
"""The last ones of a capture (paper, section 4)."""
CAMERA_STEP, CAMERA_OFFSET = 10, 4
"""Of the sorted ids of a capture's colour cameras, every tenth is held out, beginning with the fifth."""


@dataclass(frozen=True)
class FrameSplit:
    """Frames and cameras in use.

    Attributes:
        source: the data they are of, such as `InterHand2.6M test/Capture0 right`.
        train_frames: their numbers, in order.
        held_out_frames: likewise.
        train_cameras: their ids.
        held_out_cameras: likewise.
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
        """Where an image belongs."""
        return split_of(frame in self.held_out_frames, camera in self.held_out_cameras)


def split_of(is_pose_held_out: bool, is_camera_held_out: bool) -> Split:
    """Where an image belongs."""
    if is_camera_held_out:
        return "test" if is_pose_held_out else "novel_camera"
    return "novel_pose" if is_pose_held_out else "train"


def default_split(
    source: str, frames: list[int], cameras: list[str], last: int, held_out: list[str] | None
) -> FrameSplit:
    """The last frames, and the named cameras or else every tenth.

    Raises:
        LiveHandError: nothing is left to train on, or a named camera is not there.
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
            f"{source} must leave frames and cameras to train on, got {len(frames)} frames of which {last} are held "
            f"out, and {len(cameras)} cameras of which {len(chosen)} are; hold out fewer"
        )
    return FrameSplit(source, tuple(frames[:first_held_out]), tuple(frames[first_held_out:]), rest, tuple(chosen))


def every(split: FrameSplit, step: int) -> FrameSplit:
    """Each `step`-th of the frames to train on and of those held out."""
    return FrameSplit(
        split.source,
        split.train_frames[::step],
        split.held_out_frames[::step],
        split.train_cameras,
        split.held_out_cameras,
    )


def split_document(split: FrameSplit) -> str:
    """The text of a split's file."""
    return json.dumps({"format": FORMAT, "version": VERSION, **asdict(split)}, indent=1) + "\n"


def load_split(path: Path, source: str) -> FrameSplit:
    """Read a split's file.

    Raises:
        LiveHandError: unreadable, malformed, of other data, or something is both trained on and held out.
    """
    try:
        document = json.loads(path.read_text())
        if (document["format"], document["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format {document['format']} {document['version']}, must be {FORMAT} {VERSION}")
        split = _from_document(document)
    except (OSError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
        raise LiveHandError(f"{path} must be a split's file ({type(error).__name__}: {error})") from error
    if split.source != source:
        raise LiveHandError(f"{path} must be of {source}, got one of {split.source}")
    both = {*split.train_frames} & {*split.held_out_frames}, {*split.train_cameras} & {*split.held_out_cameras}
    if any(both):
        raise LiveHandError(
            f"{path}: what is held out must not be trained on, got both for {sorted(map(str, both[0] | both[1]))[:5]}"
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
