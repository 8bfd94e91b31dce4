"""LiveHand's tables (`.csv`): a row for each hand in each frame, with axis-angles of the joints, Z up."""

from __future__ import annotations

import numpy as np

from ...hand.model import JOINT_NAMES
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..motion import MOST_FRAMES, shared
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "LiveHand table"
FRAME, TIME, HAND = "frame", "time_s", "hand"
THETA = tuple(f"{joint}_r{axis}" for joint in JOINT_NAMES for axis in "xyz")
TRANSL = tuple(f"transl_{axis}" for axis in "xyz")
FOREARM = tuple(f"forearm_r{axis}" for axis in "xyz")
BETAS = tuple(f"beta{k}" for k in range(10))


def _matches(document: Document) -> bool:
    return {FRAME, HAND, *THETA, *TRANSL} <= document.entries.keys()


def _read(document: Document) -> PoseFile:
    entries, path = document.entries, document.path
    numbers = document.array(entries[FRAME], FRAME, (None,)).round().astype(int)
    labels = np.char.lower(np.asarray(entries[HAND]).astype(str))
    if unknown := sorted(set(labels.tolist()) - set(SIDES)):
        raise LiveHandError(f"{path}: {HAND} must be right or left in every row, got {unknown[0]!r}; export it again")
    if numbers.max() - numbers.min() >= MOST_FRAMES:
        raise LiveHandError(f"{path}: frames must lie within {MOST_FRAMES}, got {numbers.min()} to {numbers.max()}")
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        rows = np.flatnonzero(labels == side)
        if not len(rows):
            continue
        frames = numbers[rows] - numbers.min()
        if (np.diff(frames) <= 0).any():
            raise LiveHandError(f"{path}: the frames of the {side} hand must increase; sort the table by {FRAME}")
        theta, transl, forearm, beta = (
            _columns(document, names, rows) for names in (THETA, TRANSL, FOREARM, BETAS)
        )  # fmt: skip
        hands[side] = raw_hand(theta, shared(beta), transl, frames, forearm=shared(forearm))
    return pose_file(path, hands, _NAME, "z_up", has_mean_added=True, fps=_fps(document, numbers))


def _columns(document: Document, names: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
    """Read [N, len(names)] of the rows; columns that are not there are zeros."""
    entries = document.entries
    zeros = np.zeros(len(entries[FRAME]))
    return np.stack([document.array(entries.get(name, zeros), name, (None,))[rows] for name in names], 1)


def _fps(document: Document, numbers: np.ndarray) -> float | None:
    """Compute the rate from the times of the first and the last frame; None: it has no times, or one frame."""
    if TIME not in document.entries:
        return None
    times = document.array(document.entries[TIME], TIME, (None,))
    first, last = int(numbers.argmin()), int(numbers.argmax())
    span_s = float(times[last] - times[first])
    return (int(numbers[last] - numbers[first])) / span_s if span_s > 0 else None


FORMAT = Format(_NAME, _matches, _read)
