"""The frames of a landmark file, whatever its layout: a list of frames, one result, or arrays of a whole take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...records.errors import LiveHandError
from ..document import Document
from ..motion import MOST_FRAMES
from .sighting import (
    Label,
    Sighting,
    holder_label,
    is_category,
    is_hand_key,
    is_point,
    label_of,
    plain_key,
    points_key,
    sightings,
)
from .table import table_frames

EXAMPLE = """a landmark file looks like this, with 21 points in metres per hand and null where there is none:
{"fps": 30, "frames": [
  {"handedness": "Left", "world_landmarks": [[0.012, 0.081, 0.005], [0.035, 0.064, -0.011], ...]},
  null,
  {"handedness": "Left", "world_landmarks": [[0.011, 0.082, 0.004], [0.034, 0.066, -0.012], ...]}]}"""
"""For people whose file was not understood."""

Frames = Sequence[Any] | np.ndarray

_FRAMES_KEYS = ("frames", "results", "data", "sequence", "recording")
_NUMBER_KEYS = ("frame", "frameindex", "frameid", "framenumber", "frameno")
_FPS_KEYS = ("fps", "framerate", "framespersecond")
_MOST_IN_RESULT = 4  # hands in the result of one picture
_FAULTS = (ValueError, TypeError, KeyError, IndexError, OverflowError, AttributeError, RecursionError)


class Recording(NamedTuple):
    """What a file holds.

    Attributes:
        frames: the hands in each frame by the frame's number; frames without a hand may be missing.
        frame_count: of the file.
        fps: frames per second; None if the file does not say.
    """

    frames: dict[int, list[Sighting]]
    frame_count: int
    fps: float | None


def is_recording(document: Document) -> bool:
    """Tell whether a document holds the points of a hand in some frame; only frames up to the first hand are read."""
    try:
        frames, _ = _frames_of(document)
        for frame in frames:
            if isinstance(frame, list) and frame and isinstance(frame[0], Sighting):
                return True
            if sightings(frame):
                return True
    except LiveHandError:
        return document.path.suffix.lower() == ".csv"
    except _FAULTS:
        return False
    return False


def read_recording(document: Document) -> Recording:
    """Read the hands of every frame.

    Raises:
        LiveHandError: a frame is malformed, or there are too many.
    """
    try:
        frames, label = _frames_of(document)
        if len(frames) > MOST_FRAMES:
            raise LiveHandError(f"must have at most {MOST_FRAMES} frames, got {len(frames)}; cut it into takes")
        numbers = _numbers(frames)
        fps = _fps(document)
    except LiveHandError as error:
        raise LiveHandError(f"{document.path}: {error}") from error
    found: dict[int, list[Sighting]] = {}
    for index, (number, frame) in enumerate(zip(numbers, frames, strict=True)):
        try:
            hands = frame if _is_read(frame) else sightings(frame, label)
        except _FAULTS as error:
            raise LiveHandError(
                f"{document.path}: frame {index} must be null or hands of 21 points, each of x, y and z, got "
                f"{error}; {EXAMPLE}"
            ) from error
        found.setdefault(number, []).extend(hands)
    return Recording(found, len(frames), fps)


def _is_read(frame: Any) -> bool:
    return isinstance(frame, list) and bool(frame) and isinstance(frame[0], Sighting)


def _frames_of(document: Document) -> tuple[Frames, Label | None]:
    """List the frames of a document, unread but those of tables, and the label that holds for all of them."""
    content = document.content
    if document.path.suffix.lower() == ".csv" and isinstance(content, dict):
        return table_frames(content), None
    if not isinstance(content, dict):
        content = _named_takes(content)
    if not isinstance(content, dict):
        return _take(content), None
    entries = {plain_key(key): value for key, value in content.items()}
    label = label_of(holder_label(entries))
    for key in _FRAMES_KEYS:
        if isinstance(entries.get(key), list | tuple | dict | np.ndarray):
            frames = entries[key]
            return (_by_number(frames) if isinstance(frames, dict) else _take(frames)), label
    if content and all(str(key).isdecimal() and len(str(key)) < 10 for key in content):
        return _by_number(content), None
    return (_columns(entries) or [content]), label


def _named_takes(content: Any) -> Any:
    """Sort a list of hands, each a name such as 'Left' beside a list of its frames, by the name."""
    takes = content if isinstance(content, list) and len(content) <= _MOST_IN_RESULT else []
    found = {}
    for take in takes:
        name = take.get("name") if isinstance(take, Mapping) else None
        lists = [value for value in take.values() if isinstance(value, list)] if name is not None else []
        if len(lists) != 1 or label_of(name) is None:
            return content
        found[name] = lists[0]
    return found or content


def _by_number(frames: Mapping) -> list[Any]:
    """List frames under their numbers, with None between them."""
    numbers = {int(str(key)): value for key, value in frames.items()}
    first, last = min(numbers, default=0), max(numbers, default=-1)
    if last - first >= MOST_FRAMES:
        raise LiveHandError(f"frames must lie within {MOST_FRAMES}, got {first} to {last}")
    return [numbers.get(number) for number in range(first, last + 1)]


def _take(frames: Any) -> Frames:
    """List the frames of a list or array; the points of one hand alone are one frame."""
    if isinstance(frames, np.ndarray) and frames.dtype.kind not in "iuf":
        raise LiveHandError(f"landmarks must hold numbers, got {frames.dtype}")
    is_one = np.size(frames[:1]) > 0 and len(frames) in (21, 25) and is_point(frames[0])
    return [frames] if is_one else frames


def _columns(entries: Mapping[str, Any]) -> list[Any] | None:
    """List the frames of a dictionary of lists over a whole take; None if it is the result of one picture."""
    given = holder_label(entries)
    takes = {
        key: value
        for key, value in entries.items()
        if (points_key(key) or is_hand_key(key)) and _is_take(key, value, given)
    }
    if not takes:
        return None
    count = max(len(value) for value in takes.values())
    labels = np.asarray(given, object).ravel().tolist() if _is_label_list(given, count) else [given] * count
    return [
        {key: value[index] for key, value in takes.items() if index < len(value)} | {"handedness": labels[index]}
        for index in range(count)
    ]


def _is_take(key: str, value: Any, given: Any) -> bool:
    if not isinstance(value, list | tuple | np.ndarray) or len(value) == 0 or is_category(given) or "multi" in key:
        return False
    if isinstance(value, np.ndarray) and value.ndim > 1:
        return value.ndim > 2 or value.shape[1] > 25
    if _is_label_list(given, len(value)) and len(value) <= _MOST_IN_RESULT and len(set(map(str, given))) == len(value):
        return len(value) == 1
    first = next((each for each in value if each is not None and np.size(each) > 0), None)
    return first is not None and bool(_hands_or_none(first))


def _hands_or_none(value: Any) -> list[Sighting]:
    try:
        return sightings(value)
    except _FAULTS:
        return [Sighting(np.zeros((21, 3)), "points")] if isinstance(value, list) and len(value) in (20, 21, 25) else []


def _is_label_list(given: Any, count: int) -> bool:
    is_list = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim == 1)
    return is_list and len(given) == count and all(isinstance(each, str) or each is None for each in given)


def _numbers(frames: Frames) -> Sequence[int]:
    """Find the number of each frame: as the frames say, or counted."""
    numbers = [_number_of(frame) for frame in frames]
    if not numbers or any(number is None for number in numbers):
        return range(len(frames))
    known = [number for number in numbers if number is not None]
    if max(known) - min(known) >= MOST_FRAMES:
        raise LiveHandError(f"frames must lie within {MOST_FRAMES}, got {min(known)} to {max(known)}")
    return known


def _number_of(frame: Any) -> int | None:
    if not isinstance(frame, Mapping):
        return None
    entries = {plain_key(key): value for key, value in frame.items()}
    number = next((entries[key] for key in _NUMBER_KEYS if key in entries), None)
    if isinstance(number, bool) or not isinstance(number, int | float | np.number) or not np.isfinite(number):
        return None
    return int(number)


def _fps(document: Document) -> float | None:
    entries = {plain_key(key): value for key, value in document.entries.items()}
    key = next((key for key in _FPS_KEYS if key in entries), None)
    if key is None or document.path.suffix.lower() == ".csv":
        return None
    return None if entries[key] is None else document.array(entries[key], "fps", (), (1,)).item()
