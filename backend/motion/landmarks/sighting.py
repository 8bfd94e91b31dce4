"""One hand in one frame, read from the spellings that trackers publish.

MediaPipe's Tasks in Python and JavaScript, its older solutions in both and their protobuf JSON, TensorFlow.js, WebXR;
points as numbers, named coordinates, poses or matrices, in a list or by the joints' names.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from ...records.side import Side
from .joint_names import read_joint_name, read_joint_names, words
from .leap import hand_points, with_fingers

Kind = Literal["world", "points", "picture"]
"""Of coordinates: metres by their name; unnamed; parts of a picture by their name. The first are preferred."""
KINDS: tuple[Kind, ...] = ("world", "points", "picture")

# MediaPipe's landmarks among WebXR's 25 joints (wrist; the thumb's 4; 5 of each finger, from the metacarpal on).
MEDIAPIPE_IN_WEBXR = (0, 1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 16, 17, 18, 19, 21, 22, 23, 24)
_COUNTS = {21: 21, 25: 25, 26: 26, 63: 21, 75: 25, 78: 26, 400: 25}
_HOLDERS = ("scene", "actors", "body")  # of bodies with hands
_POINTS_KEY = re.compile(
    r"(left|right)?(multi)?(hands?)?(world|image|picture|normali[sz]ed)?"
    r"(landmarks?|keypoints(?:3d|2d)?|joints?|joint(?:positions|transforms)|positions|points)(world)?"
)
_NESTED_KEY = re.compile(r"(left|right)?(hands?|inputsources?)?(result)?")
_LABEL_KEYS = ("handedness", "handednesses", "multihandedness", "label", "side", "hand", "handlabel", "handtype")
_LABEL_TEXTS = ("label", "categoryname", "displayname", "classname", "handedness", "side")
_POSITIONS = ("position", "transform", "pose", "matrix", "offsetMatrix", "translation", "location")
_DEEPEST = 6


class Label(NamedTuple):
    """Which hand a file says that points are.

    Attributes:
        side: as the file says.
        score: the tracker's confidence.
        is_own: the label is surely the hand's own, not that of a picture taken for a mirrored one.
    """

    side: Side
    score: float = 1.0
    is_own: bool = False


class Sighting(NamedTuple):
    """One hand in one frame.

    Attributes:
        points: [21, 3] in MediaPipe's order; NaN where the file has no hand.
        kind: of the coordinates.
        label: which hand the file says it is; None if it does not.
        is_mediapipe: the points are MediaPipe's, not WebXR's.
    """

    points: np.ndarray
    kind: Kind
    label: Label | None = None
    is_mediapipe: bool = True


def plain_key(key: object) -> str:
    """Spell a key without case and signs, so that `handWorldLandmarks` is `hand_world_landmarks`."""
    return re.sub(r"[^a-z0-9]", "", str(key).lower())


def sightings(frame: Any, label: Label | None = None, kind: Kind = "points", depth: int = 0) -> list[Sighting]:
    """Read the hands of a frame; empty if it has none.

    Args:
        frame: a result of a tracker, a list of hands, or the points of one.
        label: of the hand, if what holds it says so.
        kind: of its coordinates, likewise.
        depth: of the nesting so far.

    Raises:
        ValueError, TypeError, KeyError: the frame is malformed.
    """
    if frame is None or isinstance(frame, str | bytes | bool | int | float) or len(frame) == 0:
        return []
    if depth > _DEEPEST:
        raise ValueError("hands nested too deeply")
    points = _points(frame)
    if points is not None:
        return [Sighting(points[0], kind, label, points[1])]
    if isinstance(frame, Mapping):
        return list(_of_result(frame, label, kind, depth))
    if _is_nested(frame[0]) or all(hand is None for hand in frame):
        return [one for hand in frame for one in sightings(hand, label, kind, depth + 1)]
    raise ValueError(f"a frame of {len(frame)} numbers")


def label_of(value: Any, depth: int = 0) -> Label | None:
    """Read the label in a text, a category, or the first of a list of them."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, str):
        text = value.strip().lower()
        side = _side_in(text)
        return Label(side) if side else None
    if depth > _DEEPEST:
        return None
    if isinstance(value, Mapping):
        entries = {plain_key(key): item for key, item in value.items()}
        score = entries.get("score", 1.0)
        for key in (*_LABEL_TEXTS, "classification"):
            found = label_of(entries[key], depth + 1) if key in entries else None
            if found:
                return found._replace(score=float(score)) if isinstance(score, int | float) else found
        return None
    return label_of(value[0], depth + 1) if isinstance(value, list | tuple) and value else None


def holder_label(entries: Mapping[str, Any]) -> Any:
    """Find the value that labels the hands of a result with plain keys; None if it has none."""
    return next((entries[key] for key in _LABEL_KEYS if key in entries and not _is_nested_hand(entries[key])), None)


def points_key(key: str) -> tuple[Label | None, Kind] | None:
    """Tell what a plain key says of the points under it; None if it is no key of points.

    Holistic trackers know the sides of a body, so that a side in such a key is the hand's own.
    """
    match = _POINTS_KEY.fullmatch(key)
    if match is None:
        return None
    side, multi, hands, space, what, world = match.groups()
    label = Label(_side_in(side) or "right", is_own=True) if side else None
    if "world" in (space, world) or what == "keypoints3d":
        return label, "world"
    is_picture = space or what in ("keypoints", "keypoints2d") or (what.startswith("landmark") and (multi or hands))
    return label, "picture" if is_picture or (side and what.startswith("landmark")) else "points"


def is_hand_key(key: str) -> bool:
    """Tell whether a plain key holds the left or the right hand, however its points are given."""
    match = _NESTED_KEY.fullmatch(key)
    return match is not None and match[1] is not None


def is_category(value: Any) -> bool:
    """Tell whether a label is a tracker's category, or lists of them, as in the result of one picture."""
    while isinstance(value, list | tuple) and value:
        value = value[0]
    return isinstance(value, Mapping)


def _of_result(result: Mapping, label: Label | None, kind: Kind, depth: int) -> Iterator[Sighting]:
    """Read the hands in the preferred kind of coordinates of a result."""
    entries = {plain_key(key): value for key, value in with_fingers(result).items()}
    given = holder_label(entries)
    label = label_of(given) or label
    of_bones = hand_points(entries)
    if of_bones is not None:
        yield Sighting(of_bones.points, "world", Label(of_bones.side, is_own=True) if of_bones.side else label, False)
        return
    groups: dict[Kind, list[tuple[Label | None, Any]]] = {name: [] for name in KINDS}
    for key, value in entries.items():
        found = points_key(key)
        if found is None or not _is_nested(value) or len(value) == 0:
            continue
        side, own_kind = found
        if own_kind == "points":
            own_kind = "picture" if key == "landmarks" and is_category(given) else kind
        groups[own_kind].append((side, value))
    chosen: Kind | None = next((name for name in KINDS if groups[name]), None)
    if chosen:
        for side, value in groups[chosen]:
            hands = sightings(value, side or label, chosen, depth + 1)
            yield from hands if side else _labelled(hands, given, label)
        return
    for key, value in entries.items():
        match = _NESTED_KEY.fullmatch(key)
        if match and key and _is_nested(value):
            side = Label(_side_in(match[1]) or "right", is_own=bool(match[2])) if match[1] else label
            yield from sightings(value, side, kind, depth + 1)
        elif key in _HOLDERS and _is_nested(value):
            yield from sightings(value, label, kind, depth + 1)
    yield from _of_sides(result, kind)


def _of_sides(result: Mapping, kind: Kind) -> Iterator[Sighting]:
    """Read the hands of a body, whose joints' names begin or end with a side."""
    for side in ("left", "right"):
        own = {key: [word for word in words(str(key)) if word != side] for key in result if side in words(str(key))}
        points = _named_points({" ".join(each): result[key] for key, each in own.items()})
        if points is not None:
            yield Sighting(points[0], kind, Label(side, is_own=True), points[1])


def _labelled(hands: list[Sighting], given: Any, label: Label | None) -> list[Sighting]:
    """Give each hand its label, where the result has as many labels as hands."""
    labels = given if isinstance(given, list | tuple) and len(given) == len(hands) else [label] * len(hands)
    each = [one if isinstance(one, Label) else label_of(one) for one in labels]
    return [hand._replace(label=hand.label if one is None else one) for hand, one in zip(hands, each, strict=True)]


def _points(value: Any) -> tuple[np.ndarray, bool] | None:
    """Return [21, 3] points and whether they are MediaPipe's; None if the value is not the points of one hand.

    Raises:
        ValueError, TypeError, KeyError: it is, and they are malformed.
    """
    if isinstance(value, Mapping):
        return _named_points(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        return _points_of_array(value)
    if _is_named_point(value[0]):
        return _named_points({_name_of(point): point for point in value})
    if isinstance(value[0], int | float | np.number):
        flat = np.array(value, float)
        return _in_order(flat.reshape(_COUNTS[len(flat)], -1)) if len(flat) in _COUNTS and len(flat) > 25 else None
    if not is_point(value[0]):
        return None
    if len(value) not in (21, 25, 26):
        raise ValueError(f"a frame of {len(value)} points")
    return _in_order(np.array([_position(point) for point in value], float))


def _points_of_array(value: np.ndarray) -> tuple[np.ndarray, bool] | None:
    if value.ndim == 1:
        return _in_order(value.reshape(_COUNTS[len(value)], -1)) if len(value) in _COUNTS and len(value) > 25 else None
    if len(value) not in (21, 25, 26) or value.shape[1:] not in ((3,), (16,), (4, 4)):
        return None
    if value.shape[1:] == (4, 4) and not value[:, 3, :3].any():  # row-major
        return _in_order(value[:, :3, 3])
    return _in_order(value.reshape(len(value), -1))


def _in_order(values: np.ndarray) -> tuple[np.ndarray, bool]:
    points = (values[:, 12:15] if values.shape[1] == 16 else values).astype(np.float64)
    if len(points) == 21:
        return points, True
    return points[len(points) - 25 :][list(MEDIAPIPE_IN_WEBXR)], False  # OpenXR's 26 begin with the palm


def _named_points(entries: Mapping) -> tuple[np.ndarray, bool] | None:
    """Sort the points by joints' names; None if fewer than all 21 are named."""
    keys = {str(key): key for key in entries}
    names = read_joint_names(keys)
    found = {name.landmark: entries[keys[key]] for key, name in names.items() if name.landmark is not None}
    if len(found) < 21 or any(value is None for value in found.values()):
        return None
    is_mediapipe = any(name.is_anatomical for name in names.values())
    return np.array([_position(found[landmark]) for landmark in range(21)], float), is_mediapipe


def _position(point: Any) -> list[float]:
    """Read x, y, z of a point with named coordinates, a list, or a 4 x 4 matrix, flat ones in column-major order."""
    for _ in range(_DEEPEST):
        key = next((key for key in _POSITIONS if key in point), None) if isinstance(point, Mapping) else None
        if key is None:
            break
        point = point[key]
    if isinstance(point, Mapping):
        if {"x", "y"} <= point.keys() and "z" not in point:
            raise ValueError("a point of x and y alone, without depth")
        return [_number(point[axis]) for axis in "xyz"]
    if len(point) == 4 and len(point[0]) == 4:
        rows = np.array(point, float)
        return rows[3, :3].tolist() if rows[3, :3].any() else rows[:3, 3].tolist()
    if len(point) == 16:
        return [_number(value) for value in point[12:15]]
    if len(point) != 3:
        raise ValueError(f"a point of {len(point)} numbers")
    return [_number(value) for value in point]


def _number(value: Any) -> float:
    if isinstance(value, bool | str) or value is None:
        raise TypeError(f"{value!r} instead of a number")
    return float(value)


def is_point(value: Any) -> bool:
    """Tell whether a value is one point: named coordinates, 2 or 3 numbers, or a matrix."""
    if isinstance(value, Mapping):
        return any(key in value for key in ("x", *_POSITIONS))
    if not isinstance(value, list | tuple | np.ndarray) or len(value) not in (2, 3, 4, 16):
        return False
    if len(value) == 4 and isinstance(value[0], list | tuple | np.ndarray):
        return len(value[0]) == 4 and not isinstance(value[0][0], list | tuple | Mapping | np.ndarray)
    return not isinstance(value[0], list | tuple | Mapping | np.ndarray) and value[0] is not None


def _is_named_point(value: Any) -> bool:
    return isinstance(value, Mapping) and read_joint_name(words(_name_of(value))) is not None


def _name_of(point: Any) -> str:
    names = (point.get(key) for key in ("name", "joint", "jointName", "joint_name", "landmark"))
    return next((name for name in names if isinstance(name, str)), "")


def _is_nested(value: Any) -> bool:
    return isinstance(value, list | tuple | Mapping) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _is_nested_hand(value: Any) -> bool:
    """Tell whether a key that may label a hand holds the hand itself, as WebXR's input sources do."""
    return isinstance(value, Mapping) and label_of(value) is None


def _side_in(text: str) -> Side | None:
    if "left" in text or text in ("l", "lh"):
        return "left"
    return "right" if "right" in text or text in ("r", "rh") else None
