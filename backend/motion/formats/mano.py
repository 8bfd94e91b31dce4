"""MANO's parameters as `livehand export --format mano` writes them: `poses` [T, 48] that say side, axes and mean."""

from __future__ import annotations

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import SIDES
from ..document import Document
from ..pose_file import PoseFile, pose_file, raw_hand
from ..spaces import SPACES
from .format import Format

_NAME = "MANO"
_KEYS = {"poses", "betas", "trans", "side", "axes", "flat_hand_mean"}


def _matches(document: Document) -> bool:
    return document.entries.keys() >= _KEYS


def _read(document: Document) -> PoseFile:
    entries = document.entries
    poses = document.array(entries["poses"], "poses", (None, 48))
    count = len(poses)
    raw = raw_hand(
        poses,
        document.array(entries["betas"], "betas", (10,), (count, 10)),
        document.array(entries["trans"], "trans", (count, 3)),
        np.arange(count) + int(document.array(entries.get("first", 0), "first", ()).item()),
    )
    side, axes = SIDES[_choice(document, "side", SIDES)], SPACES[_choice(document, "axes", SPACES)]
    is_flat = bool(document.array(entries["flat_hand_mean"], "flat_hand_mean", ()).item())
    fps = document.array(entries["fps"], "fps", ()).item() if "fps" in entries else None
    return pose_file(document.path, {side: raw}, _NAME, axes, has_mean_added=is_flat, fps=fps)


def _choice(document: Document, name: str, allowed: tuple[str, ...]) -> int:
    """Return which of the allowed words an entry is."""
    value = str(np.asarray(document.entries[name]))
    if value not in allowed:
        raise LiveHandError(f"{document.path}: {name} must be one of {', '.join(allowed)}, got {value!r}")
    return allowed.index(value)


FORMAT = Format(_NAME, _matches, _read)
