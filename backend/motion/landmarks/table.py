"""Landmarks in tables: a row per frame with a column per coordinate, or a row per landmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...records.errors import LiveHandError
from ..motion import MOST_FRAMES
from .joint_names import read_joint_names, words
from .sighting import MEDIAPIPE_IN_WEBXR, Kind, Label, Sighting, label_of, plain_key

_FRAME_KEYS = ("frame", "frameindex", "frameid", "framenumber", "frameno")
_TIME_KEYS = ("time", "timestamp", "timestampms", "timems", "times", "t")
_LANDMARK_KEYS = (
    *("landmark", "landmarkindex", "landmarkid", "landmarkname", "landmarknumber", "joint", "jointname", "jointid"),
    *("jointindex", "bone", "bonename", "point", "pointid", "keypoint", "keypointid", "name", "index", "id"),
)
_HAND_KEYS = ("handedness", "hand", "handlabel", "label", "side", "handtype", "type", "handindex", "handid")
_COUNTS = (21, 25, 26)
_BEFORE_AXIS = ("", "position", "pos", "world", "location", "translation")  # before the axis, in a coordinate's column


class _Column(NamedTuple):
    """What a column's name says: the hand, whether of world landmarks, the landmark (a number or a name), the axis."""

    hand: str
    is_world: bool
    landmark: int | str
    axis: int


def table_frames(columns: Mapping[str, np.ndarray]) -> list[list[Sighting]]:
    """Read the hands of each frame of a table, from its columns by name.

    Raises:
        LiveHandError: it has no landmarks, or not all of a hand's.
    """
    plain = {plain_key(name): values for name, values in columns.items()}
    landmark = next((key for key in _LANDMARK_KEYS if key in plain), None)
    place = next((place for place in _BEFORE_AXIS if all(place + axis in plain for axis in "xyz")), None)
    if landmark is not None and place is not None:
        return _frames_of_rows({**plain, **{axis: plain[place + axis] for axis in "xyz"}}, landmark)
    return _frames_of_columns(columns, plain)


def _frames_of_columns(columns: Mapping[str, np.ndarray], plain: Mapping[str, np.ndarray]) -> list[list[Sighting]]:
    """Read columns such as x0, y0, z0, landmark_3_z, wrist_x or right_thumb_tip_y."""
    found = {column: columns[name] for name in columns if (column := _read_column(name)) is not None}
    hands = {(column.hand, column.is_world) for column in found}
    chosen = sorted(hand for hand, is_world in hands if is_world or (hand, True) not in hands)
    rows = len(next(iter(columns.values())))
    labels = next((plain[key] for key in _HAND_KEYS if key in plain), None)
    frames: dict[int, list[Sighting]] = {}
    for hand in chosen:
        is_world = (hand, True) in hands
        points, is_mediapipe = _points(found, hand, is_world, rows)
        own = Label("left" if hand == "left" else "right", is_own=True) if hand else None
        for row, number in enumerate(_numbers(plain, rows)):
            label = own if own or labels is None else label_of(str(labels[row]))
            kind: Kind = "world" if is_world else "points"
            frames.setdefault(number, []).append(Sighting(points[row], kind, label, is_mediapipe))
    return [frames.get(number, []) for number in range(max(frames, default=-1) + 1)]


def _points(found: Mapping[_Column, np.ndarray], hand: str, is_world: bool, rows: int) -> tuple[np.ndarray, bool]:
    """Return [rows, 21, 3] of one hand's columns, and whether they are MediaPipe's."""
    own = {column: values for column, values in found.items() if (column.hand, column.is_world) == (hand, is_world)}
    landmarks = {column.landmark for column in own}
    numbers = sorted(landmark for landmark in landmarks if isinstance(landmark, int))
    if numbers and len(numbers) == len(landmarks) and len(numbers) in _COUNTS:
        place: dict[int | str, int | None] = {number: index for index, number in enumerate(numbers)}
        is_mediapipe = len(numbers) == 21
    else:
        names = read_joint_names(map(str, landmarks))
        place = {landmark: names[str(landmark)].landmark for landmark in landmarks if str(landmark) in names}
        is_mediapipe = any(name.is_anatomical for name in names.values())
        numbers = []
    points = np.full((rows, max(21, len(numbers)), 3), np.nan)
    given = set()
    for column, values in own.items():
        index = place.get(column.landmark)
        if index is None:
            continue
        if values.dtype.kind != "f":
            raise LiveHandError(f"the column of {column.landmark} {'xyz'[column.axis]} must hold numbers, got text")
        points[:, index, column.axis] = values
        given.add((index, column.axis))
    if len(given) != points.shape[1] * 3:
        raise LiveHandError(f"a table must have x, y and z of 21 landmarks, got {len(given)} columns of them")
    return (points if len(numbers) < 25 else points[:, len(numbers) - 25 :][:, MEDIAPIPE_IN_WEBXR]), is_mediapipe


def _read_column(name: str) -> _Column | None:
    rest = words(name)
    axes = [word for word in rest if word in ("x", "y", "z")]
    if len(axes) != 1:
        return None
    rest.remove(axes[0])
    hand = next((side for side in ("left", "right") if side in rest), "")
    is_world = "world" in rest
    rest = [word for word in rest if word not in ("left", "right", "world")]
    numbers = [int(word) for word in rest if word.isdecimal() and len(word) < 4]
    axis = "xyz".index(axes[0])
    if read_joint_names([" ".join(rest)]):
        return _Column(hand, is_world, " ".join(rest), axis)
    return _Column(hand, is_world, numbers[0], axis) if len(numbers) == 1 else None


def _frames_of_rows(plain: Mapping[str, np.ndarray], landmark: str) -> list[list[Sighting]]:
    """Read a row per landmark: frame, landmark, x, y, z and, if it has one, the hand."""
    is_world = {"worldx", "worldy", "worldz"} <= plain.keys()
    coordinates = [plain[f"world{axis}" if is_world else axis] for axis in "xyz"]
    if any(values.dtype.kind != "f" for values in coordinates):
        raise LiveHandError("the columns x, y and z must hold numbers, got text")
    xyz = np.stack(coordinates, 1)
    hands = next((plain[key] for key in _HAND_KEYS if key in plain and key != landmark), None)
    names = [str(hand) for hand in hands] if hands is not None else [_side_of(name) for name in plain[landmark]]
    positions, is_mediapipe = _positions(plain[landmark], [_is_hand(name) for name in names])
    numbers = _numbers(plain, len(xyz), is_long=True)
    found: dict[tuple[int, str], np.ndarray] = {}
    for row, (number, name, place) in enumerate(zip(numbers, names, positions, strict=True)):
        if place is not None:
            found.setdefault((number, name), np.full((21, 3), np.nan))[place] = xyz[row]
    frames: list[list[Sighting]] = [[] for _ in range(max((number for number, _ in found), default=-1) + 1)]
    for (number, name), points in found.items():
        label = label_of(name)
        is_own = "hand" in name.lower()
        label = label._replace(is_own=is_own) if label else None
        frames[number].append(Sighting(points, "world" if is_world else "points", label, is_mediapipe))
    return frames


def _side_of(joint: Any) -> str:
    """Find the hand that a joint's own name tells, such as `LeftIndexTip`; empty: it does not."""
    side = next((word for word in words(str(joint)) if word in ("left", "right")), "")
    return f"{side} hand" if side else ""


def _without_side(joint: str) -> str:
    return " ".join(word for word in words(joint) if word not in ("left", "right"))


def _is_hand(name: str) -> bool:
    return name.strip().lower() not in ("face", "pose", "body")


def _positions(landmarks: np.ndarray, is_hand: Sequence[bool]) -> tuple[list[int | None], bool]:
    """Find the place of each row among the 21 landmarks, and whether they are MediaPipe's."""
    if landmarks.dtype.kind == "f":
        known = sorted({float(value) for value, hand in zip(landmarks, is_hand, strict=True) if hand})
        if len(known) not in _COUNTS:
            raise LiveHandError(f"a table must have rows of 21 landmarks, got {len(known)}")
        order = known if len(known) == 21 else [known[len(known) - 25 :][index] for index in MEDIAPIPE_IN_WEBXR]
        place = {value: index for index, value in enumerate(order)}
        rows = zip(landmarks, is_hand, strict=True)
        return [place.get(float(value)) if hand else None for value, hand in rows], len(known) == 21
    landmarks = np.array([_without_side(str(value)) for value in landmarks])
    names = read_joint_names(np.unique(landmarks).tolist())
    found = {name.landmark for name in names.values() if name.landmark is not None}
    if len(found) != 21:
        raise LiveHandError(f"a table must have rows of 21 landmarks, got names of {len(found)}")
    is_mediapipe = any(name.is_anatomical for name in names.values())
    return [names[str(value)].landmark if str(value) in names else None for value in landmarks], is_mediapipe


def _numbers(plain: Mapping[str, np.ndarray], rows: int, is_long: bool = False) -> Sequence[int]:
    """Find the frame of each row, from 0: as its column says, by the distinct times, or counted.

    Raises:
        LiveHandError: a table with a row per landmark has no frames, or frames lie too far apart.
    """
    values = _finite(plain, _FRAME_KEYS)
    if values is None and is_long:
        times = _finite(plain, _TIME_KEYS)
        if times is not None:
            return np.unique(times, return_inverse=True)[1].tolist()
        clock = next((plain[key].tolist() for key in _TIME_KEYS if key in plain and plain[key].dtype.kind == "U"), None)
        if clock is None:
            raise LiveHandError("a table with a row per landmark must have a column 'frame' or 'time'")
        order = {time: number for number, time in enumerate(dict.fromkeys(clock))}
        return [order[time] for time in clock]
    is_labelled = is_long or any(key in plain for key in _HAND_KEYS)
    if values is None or (not is_labelled and len(np.unique(values)) < rows):
        return range(rows)
    first, last = values.min(), values.max()
    if last - first >= MOST_FRAMES:
        raise LiveHandError(f"frames must lie within {MOST_FRAMES}, got {first:g} to {last:g}")
    return (values - first).astype(int).tolist()


def _finite(plain: Mapping[str, np.ndarray], keys: Sequence[str]) -> np.ndarray | None:
    key = next((key for key in keys if key in plain), None)
    is_usable = key is not None and plain[key].dtype.kind == "f" and np.isfinite(plain[key]).all()
    return plain[key] if is_usable and key is not None else None
