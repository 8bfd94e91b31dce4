"""Opens motion files: detects the format of one file, or joins several one-frame files into one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ...system.files import is_file, is_folder
from ..document import SUFFIXES, Document, load_document
from ..formats import (
    arctic,
    body,
    dexycb,
    freihand,
    grab,
    hamer,
    ho3d,
    hot3d,
    mano,
    openxr,
    own,
    own_table,
    raw,
    wilor_frames,
)
from ..formats.format import Format
from ..formats.neural_annot import is_neural_annot, read_neural_annot
from ..gate import bends_backwards
from ..landmarks.landmark_file import LandmarkFile, is_landmarks, read_landmarks
from ..landmarks.recording import EXAMPLE
from ..landmarks.take_file import TakeFile, is_take, read_take
from ..motion import MOST_FRAMES, shared
from ..pose_file import NoHandError, PoseFile, RawHand
from .other_files import advice, advice_by_suffix

# The most specific first: the first format that matches reads the document.
FORMATS: tuple[Format, ...] = (
    own.FORMAT,
    mano.FORMAT,
    openxr.FORMAT,
    own_table.FORMAT,
    hamer.FORMAT,
    wilor_frames.FORMAT,
    grab.FORMAT,
    body.AMASS,
    body.SMPLX,
    arctic.FORMAT,
    dexycb.FORMAT,
    ho3d.FORMAT,
    hot3d.FORMAT,
    freihand.FORMAT,
    raw.FORMAT,
)

_LONGEST_NUMBER = 10  # digits of a frame in a file's name

MotionFile = PoseFile | LandmarkFile | TakeFile


def open_files(paths: Sequence[Path]) -> MotionFile:
    """Read one file of any kind, or several one-frame files of poses.

    Raises:
        LiveHandError: as `open_motion_file` and `open_pose_files`.
    """
    return open_motion_file(paths[0]) if len(paths) == 1 else open_pose_files(paths)


def open_motion_file(path: Path, capture: int | None = None) -> MotionFile:
    """Read a file of poses or landmarks, or a folder of one-frame pose files in the order of their names.

    Args:
        path: the file or folder.
        capture: of InterHand2.6M's NeuralAnnot; None takes the first in the file.

    Raises:
        LiveHandError: the file is missing, damaged, of no known format, or has no hand.
    """
    if is_folder(path):
        return open_pose_files(pose_files_in(path))
    if is_neural_annot(path):
        return read_neural_annot(path, capture)
    if is_file(path) and (words := advice_by_suffix(path)):
        raise LiveHandError(f"{path} must be a pose file ({', '.join(SUFFIXES)}), got {path.suffix}: {words}")
    document = load_document(path)
    for known in FORMATS:
        if known.matches(document):
            return known.read(document)
    if is_take(document):
        return read_take(document)
    is_table = path.suffix.lower() == ".csv"  # of which is known only while it is read whether it has landmarks
    if not is_table and is_landmarks(document):
        return read_landmarks(document)
    if words := advice(document.content):
        raise LiveHandError(f"{path} must hold poses or landmarks, got {words}")
    if is_table and is_landmarks(document):
        return read_landmarks(document)
    names = ", ".join(known.name for known in FORMATS)
    raise LiveHandError(
        f"{path} must be of a known format ({names}, InterHand2.6M NeuralAnnot, landmarks), got {_kind(document)}; "
        f"{EXAMPLE}"
    )


def _kind(document: Document) -> str:
    """Say in words what a document is."""
    content = document.content
    if isinstance(content, dict):
        packed = f", and Python objects in {', '.join(sorted(document.packed)[:4])}" if document.packed else ""
        return f"keys {document.keys_in_words}{packed}"
    return f"an array {list(content.shape)}" if isinstance(content, np.ndarray) else f"a {type(content).__name__}"


def open_pose_file(path: Path, capture: int | None = None) -> PoseFile:
    """Read a file of poses, as `open_motion_file`.

    Raises:
        LiveHandError: as `open_motion_file`, or the file holds landmarks.
    """
    file = open_motion_file(path, capture)
    if isinstance(file, LandmarkFile | TakeFile):
        raise LiveHandError(f"{path} must hold poses, got {file.info.format}; import it onto a hand to fit it")
    return file


def pose_files_in(folder: Path) -> list[Path]:
    """List the pose files of a folder that have its most frequent suffix.

    Raises:
        LiveHandError: there are none.
    """
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if not files:
        raise LiveHandError(f"{folder} must hold pose files ({', '.join(SUFFIXES)}), got none")
    suffixes = [path.suffix.lower() for path in files]
    most_frequent = max(set(suffixes), key=suffixes.count)
    return [path for path in files if path.suffix.lower() == most_frequent]


def open_pose_files(paths: Sequence[Path]) -> PoseFile:
    """Join files of one format in time; a file without a hand is a gap.

    Raises:
        LiveHandError: as `open_pose_file`, or the files differ in format.
    """
    if len(paths) == 1:
        return open_pose_file(paths[0])
    found = [_open_frame(path) for path in paths]
    files = [file for file in found if file is not None]
    if not files:
        raise LiveHandError(f"{paths[0].parent} must hold a frame with a hand, got none in {len(paths)} files")
    formats = sorted({file.info.format for file in files})
    if len(formats) > 1:
        raise LiveHandError(f"the files must be of one format, got {', '.join(formats)}; choose files of one recording")
    starts, found = _starts(paths, found), _of_one_side(found)
    hands: dict[Side, RawHand] = {side: hand for side in SIDES if (hand := _joined(found, starts, side)) is not None}
    side = files[0].info.side if files[0].info.side in hands else next(iter(hands))
    return replace(files[0], hands=hands).with_changes(side=side)


def _open_frame(path: Path) -> PoseFile | None:
    try:
        return open_pose_file(path)
    except NoHandError:
        return None


def _starts(paths: Sequence[Path], files: Sequence[PoseFile | None]) -> list[int]:
    """Find the frame of each file, or its first: files of one frame each by the numbers that end their names."""
    lengths = [1 if one is None else max(int(raw.frame_indices[-1]) + 1 for raw in one.hands.values()) for one in files]
    ends = [re.search(r"\d+$", path.name.split(".")[0]) for path in paths]
    numbers = np.array([int(end[0]) if end and len(end[0]) < _LONGEST_NUMBER else -1 for end in ends])
    if max(lengths) > 1 or numbers.min() < 0 or (np.diff(numbers) <= 0).any():
        return [sum(lengths[:index]) for index in range(len(lengths))]
    frames = (numbers - numbers[0]) // max(1, int(np.gcd.reduce(np.diff(numbers))))
    return frames.tolist() if frames[-1] < MOST_FRAMES else list(range(len(paths)))


def _joined(files: Sequence[PoseFile | None], starts: Sequence[int], side: Side) -> RawHand | None:
    """Join one hand of all files; beta is [N, 10] if it differs between them."""
    there = [
        (file.hands[side], start) for file, start in zip(files, starts, strict=True) if file and side in file.hands
    ]
    parts, first_frames = [raw for raw, _ in there], [start for _, start in there]
    if not parts:
        return None
    if len({part.fingers.shape[1] for part in parts}) > 1:
        raise LiveHandError("all files must have equally many numbers per frame; choose files of one recording")
    betas = np.concatenate([np.broadcast_to(part.beta, (len(part.root), 10)) for part in parts])
    forearms = np.concatenate([np.broadcast_to(part.forearm, (len(part.root), 3)) for part in parts])
    whole = replace(
        parts[0],
        root=np.concatenate([part.root for part in parts]),
        fingers=np.concatenate([part.fingers for part in parts]),
        beta=shared(betas),
        forearm=shared(forearms),
        transl=np.concatenate([part.transl for part in parts]),
        frame_indices=np.concatenate(
            [part.frame_indices + first for part, first in zip(parts, first_frames, strict=True)]
        ),
    )
    return whole if len({part.angles_side for part in parts}) == 1 else _of_likelier_angles(whole, side)


def _of_one_side(files: Sequence[PoseFile | None]) -> list[PoseFile | None]:
    """Give files of one hand that do not say which one side: that like which its fingers bend in all of them."""
    there = [file for file in files if file is not None]
    sides = {side for file in there for side in file.hands}
    if len(sides) < 2 or not all(file.info.is_side_guessed and len(file.hands) == 1 for file in there):
        return list(files)
    pose = np.concatenate([_pose(raw) for file in there for raw in file.hands.values()])
    side: Side = "left" if bends_backwards(pose, "right") else "right"
    return [file and replace(file, hands={side: _own_hand(file, side)}) for file in files]


def _own_hand(file: PoseFile, side: Side) -> RawHand:
    raw = next(iter(file.hands.values()))
    return replace(raw, angles_side=raw.angles_side and side)


def _of_likelier_angles(raw: RawHand, side: Side) -> RawHand:
    """Decide for all frames whose angles they are."""
    other: Side = "left" if side == "right" else "right"
    return replace(raw, angles_side=other if bends_backwards(_pose(raw), side) else side)


def _pose(raw: RawHand) -> np.ndarray:
    """Return absolute angles [N, 16, 3] as the file stores them."""
    return np.concatenate([raw.root, raw.fingers], 1).reshape(-1, 16, 3)
