"""BVH files whose joints' translation channels are zeros or changes, not places: they get their OFFSETs.

Blender's importer, as the format has it, takes such a channel for the joint's place below its parent, so that zeros put
all joints into one place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..records.errors import LiveHandError

_AXES = {"Xposition": 0, "Yposition": 1, "Zposition": 2}
_NEAR = 0.5  # share of an OFFSET's length, by which a place may differ from it on average
_MOST_CHANNELS = 100_000


class _Joint(NamedTuple):
    """OFFSET [3], the first of its channels, and for each axis (0 to 2) that has one, its channel."""

    offset: np.ndarray
    positions: dict[int, int]
    is_root: bool


def with_offsets(text: str) -> str | None:
    """Return the file with OFFSETs added to the translations of joints that lack them; None: it is right as it is.

    Raises:
        LiveHandError: the hierarchy or the frames are malformed.
    """
    head, mark, motion = text.partition("MOTION")
    if not mark:
        raise LiveHandError("a BVH file must have a MOTION, got none; export it again")
    joints, width = _joints(head.split())
    lines = motion.splitlines()
    first = next((index + 1 for index, line in enumerate(lines) if line.strip().lower().startswith("frame time")), None)
    if first is None:
        raise LiveHandError("a BVH file must have a Frame Time, got none; export it again")
    rows = [line for line in lines[first:] if line.strip()]
    if not rows:
        return None
    frames = _numbers(rows, width)
    is_changed = False
    for joint in joints:
        if joint.is_root or len(joint.positions) < len(_AXES) or not _lacks_offset(joint, frames):
            continue
        for axis, channel in joint.positions.items():
            frames[:, channel] += joint.offset[axis]
        is_changed = True
    if not is_changed:
        return None
    body = [" ".join(f"{value:.6f}" for value in row) for row in frames]
    return "\n".join([head + mark + "\n".join(lines[:first]), *body, ""])


def _lacks_offset(joint: _Joint, frames: np.ndarray) -> bool:
    """Tell whether a joint's translations are nearer to none than to its OFFSET."""
    positions = frames[:, [joint.positions[axis] for axis in range(3)]].mean(0)
    length = float(np.linalg.norm(joint.offset))
    return bool(
        np.linalg.norm(positions - joint.offset) > _NEAR * length and np.linalg.norm(positions) < _NEAR * length
    )


def _joints(words: list[str]) -> tuple[list[_Joint], int]:
    """Read the joints of a hierarchy's words, and how many channels a frame has."""
    joints, channel, offset, is_root = [], 0, np.zeros(3), False
    for index, word in enumerate(words):
        if word in ("ROOT", "JOINT", "End"):
            is_root = word == "ROOT"
        elif word == "OFFSET":
            offset = _floats(words[index + 1 : index + 4], 3)
        elif word == "CHANNELS":
            count = int(_floats(words[index + 1 : index + 2], 1)[0])
            if not 0 <= count <= _MOST_CHANNELS:
                raise LiveHandError(f"a BVH joint must have a number of CHANNELS, got {count}; export it again")
            names = words[index + 2 : index + 2 + count]
            found = {_AXES[name]: channel + k for k, name in enumerate(names) if name in _AXES}
            joints.append(_Joint(offset, found, is_root))
            channel += count
    return joints, channel


def _numbers(rows: list[str], width: int) -> np.ndarray:
    """Read [T, width]."""
    values = [row.split() for row in rows]
    if any(len(row) != width for row in values):
        raise LiveHandError(f"every frame of this BVH file must have {width} numbers, as its CHANNELS; export it again")
    return np.stack([_floats(row, width) for row in values])


def _floats(words: list[str], count: int) -> np.ndarray:
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise LiveHandError(f"a BVH file must hold numbers, got {error}; export it again") from error
    if len(values) != count or not np.isfinite(values).all():
        raise LiveHandError(f"a BVH file must hold {count} finite numbers, got {words[:6]}; export it again")
    return values
