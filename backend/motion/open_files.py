"""Any pose file, or several of one kind: which format it is, and what it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..records.shot import SIDES, Side
from .document import SUFFIXES, Document, load_document
from .formats import arctic, body, dexycb, freihand, hamer, ho3d, own, raw
from .formats.format import Format
from .formats.neural_annot import is_neural_annot, read_neural_annot
from .landmarks.landmark_file import LandmarkFile, is_landmarks, read_landmarks
from .pose_file import NoHandError, PoseFile, RawHand

# The most telling first: a document is read as the first that it is like.
FORMATS: tuple[Format, ...] = (
    own.FORMAT,
    hamer.FORMAT,
    body.AMASS,
    body.SMPLX,
    arctic.FORMAT,
    dexycb.FORMAT,
    ho3d.FORMAT,
    freihand.FORMAT,
    raw.FORMAT,
)


MotionFile = PoseFile | LandmarkFile


def open_motion_file(path: Path, capture: int | None = None) -> MotionFile:
    """Read a file of poses or of landmarks, or a folder of one-frame files of poses in the order of their names.

    Args:
        path: the file or folder.
        capture: of InterHand2.6M's NeuralAnnot; None takes the file's first.

    Raises:
        LiveHandError: missing, damaged, of no known format, or without a hand.
    """
    if path.is_dir():
        return open_pose_files(files_in(path))
    if is_neural_annot(path):
        return read_neural_annot(path, capture)
    document = load_document(path)
    known = _format_of(document)
    if known is None and is_landmarks(document):
        return read_landmarks(document)
    return _read(document, known)


def open_pose_file(path: Path, capture: int | None = None) -> PoseFile:
    """As `open_motion_file`, but of poses only.

    Raises:
        LiveHandError: as there, or it holds landmarks.
    """
    opened = open_motion_file(path, capture)
    if isinstance(opened, LandmarkFile):
        raise LiveHandError(f"{path} must hold poses, got {opened.reading.format}; import it onto a hand to fit it")
    return opened


def files_in(folder: Path) -> list[Path]:
    """The pose files of a folder of frames: all of the suffix that most of them have.

    Raises:
        LiveHandError: none.
    """
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    suffixes = [path.suffix.lower() for path in files]
    if not files:
        raise LiveHandError(f"{folder} must hold pose files ({', '.join(SUFFIXES)}), got none")
    most = max(set(suffixes), key=suffixes.count)
    return [path for path in files if path.suffix.lower() == most]


def _format_of(document: Document) -> Format | None:
    """The first format that it is like."""
    return next((known for known in FORMATS if known.is_like(document)), None)


def _read(document: Document, known: Format | None) -> PoseFile:
    if known is None:
        content = document.content
        got = f"keys {sorted(content)[:12]}" if isinstance(content, dict) else f"a {type(content).__name__}"
        names = ", ".join(each.name for each in FORMATS)
        raise LiveHandError(f"{document.path} must be of a known format ({names}, InterHand2.6M, landmarks), got {got}")
    return known.read(document)


def open_pose_files(paths: Sequence[Path]) -> PoseFile:
    """Files of one format, one after the other in time; files without a hand are gaps.

    Raises:
        LiveHandError: as `open_pose_file`, or the files differ in format.
    """
    if len(paths) == 1:
        return open_pose_file(paths[0])
    found: list[PoseFile | None] = []
    for path in paths:
        try:
            found.append(open_pose_file(path))
        except NoHandError:
            found.append(None)
    files = [file for file in found if file is not None]
    if not files:
        raise LiveHandError(f"{paths[0].parent} must hold a frame with a hand, got none in {len(paths)} files")
    formats = sorted({file.reading.format for file in files})
    if len(formats) > 1:
        raise LiveHandError(f"the files must be of one format, got {', '.join(formats)}; choose files of one take")
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        raw_hand = _joined(found, side)
        if raw_hand is not None:
            hands[side] = raw_hand
    side = files[0].reading.side if files[0].reading.side in hands else next(iter(hands))
    return replace(files[0], hands=hands).turned_round(side=side)


def _joined(files: Sequence[PoseFile | None], side: Side) -> RawHand | None:
    """One hand of all files; its shape is kept per frame where it differs."""
    parts: list[RawHand] = []
    starts: list[int] = []
    start = 0
    for file in files:
        if file is not None and side in file.hands:
            parts.append(file.hands[side])
            starts.append(start)
        start += 1 if file is None else max(int(raw.entries[-1]) + 1 for raw in file.hands.values())
    if not parts:
        return None
    if len({part.fingers.shape[1] for part in parts}) > 1:
        raise LiveHandError(
            "the files must have as many numbers per frame, got different ones; choose files of one take"
        )
    betas = np.concatenate([np.broadcast_to(part.beta, (len(part.root), 10)) for part in parts])
    return replace(
        parts[0],
        root=np.concatenate([part.root for part in parts]),
        fingers=np.concatenate([part.fingers for part in parts]),
        beta=betas[0] if (betas == betas[0]).all() else betas,
        transl=np.concatenate([part.transl for part in parts]),
        entries=np.concatenate([part.entries + start for part, start in zip(parts, starts, strict=True)]),
    )
