"""InterHand2.6M's NeuralAnnot `.json`, one capture of it; streamed because the whole file is large."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...capture.importers.interhand import NeuralAnnotFit, read_fits
from ...capture.importers.json_stream import member_names
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand

_NAME = "InterHand2.6M NeuralAnnot"


def is_neural_annot(path: Path) -> bool:
    """Tell whether the file has the name that the data set gives it."""
    return path.suffix.lower() == ".json" and "neuralannot" in path.stem.lower()


def read_neural_annot(path: Path, capture: int | None = None) -> PoseFile:
    """Read the frames of one capture in the order of their numbers; None takes the first capture.

    Raises:
        LiveHandError: the file is malformed or lacks the capture.
    """
    name = next(member_names(path), None) if capture is None else str(capture)
    if name is None or not name.isdecimal():
        raise LiveHandError(f"{path} must hold captures by their numbers, got {name!r}")
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        raw = _hand(read_fits(path, int(name), side))
        if raw is not None:
            hands[side] = raw
    notes = (f"capture {name}; its frames are assumed to be evenly spaced",)
    return pose_file(path, hands, _NAME, "z_up", has_mean_added=False, notes=notes)


def _hand(fits: dict[int, NeuralAnnotFit | None]) -> RawHand | None:
    ordered = [fits[frame] for frame in sorted(fits)]
    present = [(index, fit) for index, fit in enumerate(ordered) if fit is not None]
    if not present:
        return None
    pose, beta, transl = (np.array([getattr(fit, key) for _, fit in present]) for key in ("pose", "shape", "trans"))
    return raw_hand(pose, beta, transl, np.array([index for index, _ in present]))
