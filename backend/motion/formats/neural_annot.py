"""InterHand2.6M's NeuralAnnot `.json`, one capture of it; read entry by entry, for the whole file is large."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...captures.importers.interhand import NeuralAnnotFit, read_fits
from ...captures.importers.json_stream import member_names
from ...records.errors import LiveHandError
from ...records.shot import SIDES, Side
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand

_NAME = "InterHand2.6M NeuralAnnot"


def is_neural_annot(path: Path) -> bool:
    """By the file's name, as the data set gives it."""
    return path.suffix.lower() == ".json" and "neuralannot" in path.stem.lower()


def read_neural_annot(path: Path, capture: int | None = None) -> PoseFile:
    """One capture's frames, in the order of their numbers; None takes the first in the file.

    Raises:
        LiveHandError: malformed, or no such capture.
    """
    name = next(member_names(path), None) if capture is None else str(capture)
    if name is None or not name.isdecimal():
        raise LiveHandError(f"{path} must hold captures by their numbers, got {name!r}")
    hands: dict[Side, RawHand] = {}
    for side in SIDES:
        raw = _hand(read_fits(path, int(name), side))
        if raw is not None:
            hands[side] = raw
    notes = (f"capture {name}; its frames are taken to follow each other evenly",)
    return pose_file(path, hands, _NAME, "z_up", has_mean_added=False, notes=notes)


def _hand(fits: dict[int, NeuralAnnotFit | None]) -> RawHand | None:
    ordered = [fits[frame] for frame in sorted(fits)]
    there = [(index, fit) for index, fit in enumerate(ordered) if fit is not None]
    if not there:
        return None
    pose, beta, transl = (np.array([getattr(fit, key) for _, fit in there]) for key in ("pose", "shape", "trans"))
    return raw_hand(pose, beta, transl, np.array([index for index, _ in there]))
