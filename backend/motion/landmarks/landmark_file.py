"""Landmark files: MediaPipe's 21 (`.json`, `.npz`, `.csv`) and WebXR's 25 joints, one hand each, read as they are.

MediaPipe's label takes the picture for a mirrored selfie. So its landmarks always have the shape of the other hand than
the label says; and where the picture was mirrored indeed, that is the mirror image of the real hand.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hand.model import MIRROR_POINT, HandModel
from ...records.errors import LiveHandError
from ...records.shot import Side
from ..document import Document
from ..motion import HandMotion
from ..pose_file import METRES, Reading, check_changes
from ..resampling import at_frames, smoothed
from .fit import GUESSED, METRIC, LandmarkFit, fit_landmarks, likelier_side

MEDIAPIPE, WEBXR = "MediaPipe landmarks", "WebXR joints"
# Of WebXR's 25 joints (wrist; thumb's 4; metacarpal to tip of the others) those that MediaPipe has too, in its order.
_OF_WEBXR = (0, 1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 16, 17, 18, 19, 21, 22, 23, 24)
_POINTS = ("world_landmarks", "hand_world_landmarks", "multi_hand_world_landmarks", "landmarks", "joints", "points")
_SIDE = ("handedness", "label", "side")
_COLUMN = re.compile(r"(?=.*?(\d+))(?:.*[^a-z])?([xyz])(?:[^a-z].*)?")


@dataclass(frozen=True)
class LandmarkFile:
    """A take of landmarks, and how it is read.

    Attributes:
        path: the file.
        points: [N, 21, 3] in MediaPipe's order, in the reading's unit; only frames with a hand.
        entries: [N] increasing: which of the file's frames these are.
        reading: what they are taken for; the mean and components are of no concern here.
        is_picture_mirrored: the tracked picture was a selfie's mirror image; the motion is turned back.
    """

    path: Path
    points: np.ndarray
    entries: np.ndarray
    reading: Reading
    is_picture_mirrored: bool = False

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hand there is."""
        return (self.reading.side,)

    def turned_round(self, *, is_picture_mirrored: bool | None = None, **changes: Any) -> LandmarkFile:
        """The same landmarks, read otherwise: fields of `Reading` by name; `side` says whose hand it really is.

        Raises:
            LiveHandError: a value that cannot be.
        """
        check_changes(changes)
        reading = replace(self.reading, **changes)
        is_mirrored = self.is_picture_mirrored if is_picture_mirrored is None else is_picture_mirrored
        if is_mirrored != self.is_picture_mirrored and "side" not in changes:
            reading = replace(reading, side=_other(reading.side))
        return replace(self, reading=reading, is_picture_mirrored=is_mirrored)

    def fit(self, model: HandModel) -> LandmarkFit:
        """The hand model on the landmarks of the frames that have some.

        Raises:
            LiveHandError: the landmarks are not a hand's, or not in metres.
        """
        trust = GUESSED if self.reading.format == MEDIAPIPE else METRIC
        return fit_landmarks(self._true_points, model, self.reading.side, self.reading.fps, trust)

    def motion(self, model: HandModel, smooth_frames: float = 0.0) -> HandMotion:
        """The fitted motion, gaps bridged, jitter smoothed over so many frames (a Gaussian's deviation)."""
        motion = self.fit(model).motion
        if len(motion) != self.reading.frames:
            motion = at_frames(motion, np.arange(self.reading.frames), self.entries - self.entries[0])
        return smoothed(motion, smooth_frames)

    def doubt(self, model: HandModel) -> str | None:
        """Why the side may be wrong; None where the hand bends as that side does."""
        likelier = likelier_side(self._true_points, model)
        return None if likelier == self.reading.side else f"the landmarks bend like a {likelier} hand"

    @property
    def _true_points(self) -> np.ndarray:
        metres = self.points * METRES[self.reading.unit]
        return metres * MIRROR_POINT if self.is_picture_mirrored else metres


def is_landmarks(document: Document) -> bool:
    """Whether a document holds 21 landmarks or 25 joints a frame."""
    try:
        return _count(document) in (21, 25)
    except (LiveHandError, ValueError, TypeError, KeyError, IndexError):
        return False


def read_landmarks(document: Document) -> LandmarkFile:
    """One hand's landmarks.

    Raises:
        LiveHandError: malformed, or no frame with a hand.
    """
    count = _count(document)
    points = _frames(document, count)
    there = np.flatnonzero(np.isfinite(points).all((1, 2)))
    if len(there) == 0:
        raise LiveHandError(f"{document.path} must have a frame with a hand, got none in {len(points)}")
    if np.isinf(points).any():
        raise LiveHandError(f"{document.path}: landmarks must be finite, got infinity; track the take again")
    side, notes = _side(document, is_mediapipe=count == 21)
    span = int(there[-1] - there[0]) + 1
    name, space = (MEDIAPIPE, "opencv") if count == 21 else (WEBXR, "y_up")
    reading = Reading(name, side, True, 0, space, "m", _fps(document), span, span - len(there), notes)
    kept = points[there] if count == 21 else points[there][:, _OF_WEBXR]
    return LandmarkFile(document.path, kept, there, replace(reading, has_place=count != 21 or _has_place(kept)))


def _has_place(points: np.ndarray) -> bool:
    """Whether a hand [N, 21, 3] moves about; MediaPipe's world landmarks count from the hand's own middle."""
    middle = points.mean(1, keepdims=True)
    reach = np.linalg.norm(points - middle, axis=-1).max()
    return bool(np.linalg.norm(middle, axis=-1).max() > reach / 2)


def _content(document: Document) -> Any:
    """The list or array of frames, or the columns of a table."""
    content = document.content
    if isinstance(content, dict) and document.path.suffix.lower() != ".csv":
        content = next((content[name] for name in _POINTS if name in content), None)
    return content


def _count(document: Document) -> int:
    """Landmarks per frame, by the first that has any."""
    content = _content(document)
    if isinstance(content, dict):
        return len({match[1] for match in map(_COLUMN.fullmatch, content) if match})
    if isinstance(content, np.ndarray):
        if content.ndim == 2:
            return {63: 21, 75: 25, 400: 25}.get(content.shape[1], 0)
        return content.shape[1] if content.ndim > 2 and content.shape[-1] in (3, 4, 16) else 0
    first = next((frame for frame in map(_points_of, content) if frame), [])
    return len(first)


def _frames(document: Document, count: int) -> np.ndarray:
    """[N, count, 3]; NaN in frames without a hand."""
    content = _content(document)
    if isinstance(content, dict):
        return _of_columns(document, content, count)
    if not isinstance(content, np.ndarray):
        nothing = [[np.nan] * 3] * count
        try:
            content = np.array([[_place(point) for point in _points_of(frame)] or nothing for frame in content], float)
        except (ValueError, TypeError, KeyError, OverflowError) as error:
            raise LiveHandError(
                f"{document.path}: each frame must be null or {count} points of x, y and z, got {error!r}"
            ) from error
    if content.dtype.kind not in "iuf":
        raise LiveHandError(f"{document.path}: landmarks must hold numbers, got {content.dtype}")
    whole = content.astype(np.float64).reshape(len(content), count, -1)
    if whole.shape[-1] == 16:
        is_row_major = content.shape[-2:] == (4, 4) and not whole[..., 12:15].any()
        return whole[..., 3:12:4] if is_row_major else whole[..., 12:15]
    if whole.shape[-1] != 3:
        raise LiveHandError(f"{document.path}: points must have x, y and z, got {whole.shape[-1]} numbers each")
    return whole


def _points_of(frame: Any) -> list:
    """A frame's points; of MediaPipe's own nesting the first hand's."""
    if isinstance(frame, dict):
        frame = next((frame[name] for name in _POINTS if name in frame), None)
    if not frame:
        return []
    return frame[0] if len(frame) == 1 else frame


def _place(point: Any) -> list[float]:
    """x, y, z of a point: named, in a row, or the last column of a 4 x 4 matrix in column-major order."""
    if isinstance(point, dict):
        point = point.get("position", point.get("matrix", point))
    if isinstance(point, dict):
        return [point["x"], point["y"], point["z"]]
    if len(point) == 16:
        return point[12:15]
    if len(point) != 3:
        raise ValueError(f"a point of {len(point)} numbers")
    return point


def _of_columns(document: Document, columns: dict[str, np.ndarray], count: int) -> np.ndarray:
    """Columns such as x0, y0, z0 or landmark_3_z."""
    matches = [(name, match) for name in columns if (match := _COLUMN.fullmatch(name))]
    rows = len(next(iter(columns.values())))
    points = np.full((rows, count, 3), np.nan)
    order = {number: k for k, number in enumerate(sorted({int(match[1]) for _, match in matches}))}
    if len(matches) != 3 * count:
        raise LiveHandError(f"{document.path} must have x, y and z of {count} landmarks, got {len(matches)} columns")
    for name, match in matches:
        if columns[name].dtype.kind != "f":
            raise LiveHandError(f"{document.path}: column {name} must hold numbers, got text")
        points[:, order[int(match[1])], "xyz".index(match[2])] = columns[name]
    return points


def _side(document: Document, is_mediapipe: bool) -> tuple[Side, tuple[str, ...]]:
    said = _said_side(document)
    if not is_mediapipe:
        return said or "right", () if said else ("the file does not say which hand it is: taken for a right one",)
    if said is None:
        return "right", ("the file has no label: taken for a right hand in a picture that was not mirrored",)
    note = f"MediaPipe's label '{said}' is of a mirrored picture: the landmarks are a {_other(said)} hand's"
    return _other(said), (note,)


def _said_side(document: Document) -> Side | None:
    """What most of the file's labels say."""
    content = document.content
    holders = [content] if isinstance(content, dict) else [f for f in content if isinstance(f, dict)]
    said = [str(holder[name]).lower() for holder in holders for name in _SIDE if name in holder]
    lefts, rights = (sum(side in text for text in said) for side in ("left", "right"))
    if lefts == rights:
        return None
    return "left" if lefts > rights else "right"


def _fps(document: Document) -> float | None:
    return document.numbers(document.entries["fps"], "fps", (), (1,)).item() if "fps" in document.entries else None


def _other(side: Side) -> Side:
    return "left" if side == "right" else "right"
