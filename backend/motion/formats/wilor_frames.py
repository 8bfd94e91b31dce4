"""WiLoR-mini's own return value, pickled or as JSON: a list of frames, each a list of hands with `wilor_preds`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...records.errors import LiveHandError
from ..document import Document
from ..pose_file import NoHandError, PoseFile
from .format import Format
from .hamer import read_rows

_NAME = "WiLoR-mini"
_PARTS = ("hand_pose", "global_orient", "betas", "pred_cam_t_full")
_HOLDERS = ("wilor_preds", "pred_mano_params")


def _matches(document: Document) -> bool:
    return any(_is_hand(hand) for _, hand in _hands(document.content))


def _read(document: Document) -> PoseFile:
    hands = [(frame, hand) for frame, hand in _hands(document.content) if _is_hand(hand)]
    if not hands:
        raise NoHandError(f"{document.path} must hold a hand, got none in any frame")
    rows = {name: [_part(hand, name) for _, hand in hands] for name in _PARTS}
    missing = [name for name in _PARTS[:2] if any(value is None for value in rows[name])]
    if missing:
        raise LiveHandError(f"{document.path}: every hand must hold {' and '.join(missing)}; save the whole result")
    stacked: dict[str, Any] = {
        name: _stacked(document, values, name)
        for name, values in rows.items()
        if all(value is not None for value in values)
    }
    sides = [hand.get("is_right", hand.get("right")) for _, hand in hands]
    if all(side is not None for side in sides):
        stacked["is_right"] = [document.array(side, "is_right", (), (1,), (1, 1)).item() for side in sides]
    stacked["frame"] = np.array([frame for frame, _ in hands])
    return read_rows(Document(document.path, stacked), first=0)


def _hands(content: Any) -> Iterator[tuple[int, Any]]:
    """Yield the hands with their frame's index; the result of one picture is one frame."""
    frames: list[Any] = [content[key] for key in sorted(content, key=str)] if isinstance(content, dict) else []
    if isinstance(content, list):
        is_one = any(isinstance(frame, Mapping) for frame in content)
        frames = [content] if is_one else content
    for index, frame in enumerate(frames):
        yield from ((index, hand) for hand in (frame if isinstance(frame, list) else ()))


def _is_hand(hand: Any) -> bool:
    return isinstance(hand, Mapping) and any(isinstance(hand.get(key), Mapping) for key in _HOLDERS)


def _part(hand: Mapping[str, Any], name: str) -> Any:
    holders = [hand[key] for key in _HOLDERS if isinstance(hand.get(key), Mapping)]
    return next((holder[name] for holder in (*holders, hand) if name in holder), None)


def _stacked(document: Document, values: list[Any], name: str) -> np.ndarray:
    """Stack one hand's part each, with or without a first axis of 1.

    Raises:
        LiveHandError: they are no numbers, or differ in shape.
    """
    arrays = [document.array(value, name) for value in values]
    rows = [array[0] if array.shape[:1] == (1,) and array.ndim > 1 else array for array in arrays]
    shapes = sorted({row.shape for row in rows})
    if len(shapes) > 1:
        raise LiveHandError(f"{document.path}: {name} must be alike in all frames, got shapes {shapes[:3]}")
    return np.stack(rows)


FORMAT = Format(_NAME, _matches, _read)
