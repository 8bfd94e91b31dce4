"""LiveHand's own motions: `.npz` with theta [T, 16, 3], beta, transl, fps, side and forearm, in the rig's own space."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ...system.files import replacing
from ...system.readers import npz_bytes
from ..document import Document
from ..gate import bends_backwards
from ..motion import HandMotion
from ..pose_file import PoseFile, pose_file, raw_hand
from .format import Format

_NAME = "LiveHand"


def write_motion(motion: HandMotion, path: Path) -> None:
    """Write a motion in double precision, atomically.

    Raises:
        LiveHandError: the name does not end in .npz, or the folder cannot be written to.
    """
    if path.suffix.lower() != ".npz":
        raise LiveHandError(f"a motion must be written to a .npz file, got {path.name}")
    arrays = {"theta": motion.theta, "beta": motion.beta, "transl": motion.transl, "side": np.array(motion.side)}
    if motion.forearm.any():
        arrays["forearm"] = motion.forearm
    if motion.fps is not None:
        arrays["fps"] = np.array(float(motion.fps))
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))


def _matches(document: Document) -> bool:
    return "theta" in document.entries


def _read(document: Document) -> PoseFile:
    entries = document.entries
    theta = document.array(entries["theta"], "theta", (None, 16, 3))
    count = len(theta)
    beta = document.array(entries.get("beta", np.zeros(10)), "beta", (10,), (count, 10))
    transl = document.array(entries.get("transl", np.zeros((count, 3))), "transl", (count, 3))
    fps = document.array(entries["fps"], "fps", ()).item() if "fps" in entries else None
    forearm = document.array(entries.get("forearm", np.zeros(3)), "forearm", (3,), (count, 3))
    raw = raw_hand(theta.reshape(count, 48), beta, transl, forearm=forearm)
    if "side" in entries:
        side, notes = _side(document, entries["side"]), ()
    else:
        side = "left" if bends_backwards(theta, "right") else "right"
        notes = (f"the file does not say which hand it is: read as a {side} one, as its fingers bend",)
    is_guessed = "side" not in entries
    return pose_file(
        document.path, {side: raw}, _NAME, "hand", has_mean_added=True, fps=fps, notes=notes, is_side_guessed=is_guessed
    )


def _side(document: Document, value: object) -> Side:
    sides = {str(each) for each in np.atleast_1d(np.asarray(value))}
    for side in SIDES:
        if sides == {side}:
            return side
    raise LiveHandError(f"{document.path}: side must be 'right' or 'left' in all frames, got {sorted(sides)}")


FORMAT = Format(_NAME, _matches, _read)
