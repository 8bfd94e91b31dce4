"""Landmark files of one hand: MediaPipe's 21 landmarks (`.json`, `.npz`, `.csv`) and WebXR's 25 joints.

MediaPipe's label assumes a mirrored selfie image, so the landmarks always have the shape of the hand opposite to the
label. If the image was mirrored, that shape is the mirror image of the real hand.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hand.model import MIRROR_POINT, HandModel
from ...records.errors import LiveHandError
from ...records.side import Side
from ..document import Document
from ..motion import HandMotion
from ..pose_file import METRES, FileInfo, check_changes, with_gaps_filled
from ..resampling import smoothed
from .fit import METRIC, MONOCULAR, LandmarkFit, fit_landmarks, likelier_side

MEDIAPIPE, WEBXR = "MediaPipe landmarks", "WebXR joints"
# MediaPipe's landmarks among WebXR's 25 joints (wrist; the thumb's 4; 5 of each finger, from the metacarpal on).
_MEDIAPIPE_IN_WEBXR = (0, 1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 16, 17, 18, 19, 21, 22, 23, 24)
_POINT_KEYS = ("world_landmarks", "hand_world_landmarks", "multi_hand_world_landmarks", "landmarks", "joints", "points")
_SIDE_KEYS = ("handedness", "label", "side")
_COLUMN = re.compile(r"(?=.*?(\d+))(?:.*[^a-z])?([xyz])(?:[^a-z].*)?")


@dataclass(frozen=True)
class LandmarkFile:
    """The landmarks of a file and their interpretation.

    Attributes:
        path: the file.
        points: [N, 21, 3] in MediaPipe's order, in the file's unit; only frames with a hand.
        frame_indices: [N] increasing; the file has no hand in the frames between them.
        info: how the file is interpreted; the mean and the components do not apply.
        is_picture_mirrored: the tracked picture was mirrored, as selfies are; the motion undoes it.
    """

    path: Path
    points: np.ndarray
    frame_indices: np.ndarray
    info: FileInfo
    is_picture_mirrored: bool = False

    @property
    def sides(self) -> tuple[Side, ...]:
        """The one hand in the file."""
        return (self.info.side,)

    def with_changes(self, *, is_picture_mirrored: bool | None = None, **changes: Any) -> LandmarkFile:
        """The same landmarks with fields of `FileInfo` replaced; `side` corrects which hand it is.

        Raises:
            LiveHandError: a value is not allowed.
        """
        check_changes(changes)
        info = replace(self.info, **changes)
        is_mirrored = self.is_picture_mirrored if is_picture_mirrored is None else is_picture_mirrored
        if is_mirrored != self.is_picture_mirrored and "side" not in changes:
            info = replace(info, side=_other(info.side))
        return replace(self, info=info, is_picture_mirrored=is_mirrored)

    def fit(self, model: HandModel) -> LandmarkFit:
        """The hand model fitted to the landmarks, in the frames with a hand.

        Raises:
            LiveHandError: the landmarks are not those of a hand in metres.
        """
        noise = MONOCULAR if self.info.format == MEDIAPIPE else METRIC
        return fit_landmarks(self._points_m, model, self.info.side, self.info.fps, noise)

    def motion(self, model: HandModel, smooth_frames: float = 0.0) -> HandMotion:
        """The fitted motion with gaps filled, smoothed by a Gaussian with this standard deviation in frames."""
        return smoothed(with_gaps_filled(self.fit(model).motion, self.frame_indices), smooth_frames)

    def warning(self, model: HandModel) -> str | None:
        """Why the side is probably wrong; None if the hand bends as one of that side."""
        likelier = likelier_side(self._points_m, model)
        return None if likelier == self.info.side else f"the landmarks bend like a {likelier} hand"

    @property
    def _points_m(self) -> np.ndarray:
        metres = self.points * METRES[self.info.unit]
        return metres * MIRROR_POINT if self.is_picture_mirrored else metres


def is_landmarks(document: Document) -> bool:
    """Whether a document holds 21 landmarks or 25 joints per frame."""
    try:
        return _count(document) in (21, 25)
    except (LiveHandError, ValueError, TypeError, KeyError, IndexError):
        return False


def read_landmarks(document: Document) -> LandmarkFile:
    """Read the landmarks of one hand.

    Raises:
        LiveHandError: the document is malformed, or no frame has a hand.
    """
    count = _count(document)
    points = _frames(document, count)
    indices = np.flatnonzero(np.isfinite(points).all((1, 2)))
    if len(indices) == 0:
        raise LiveHandError(f"{document.path} must have a frame with a hand, got none in {len(points)}")
    if np.isinf(points).any():
        raise LiveHandError(f"{document.path}: landmarks must be finite, got infinity; track the hand again")
    side, notes = _side(document, is_mediapipe=count == 21)
    span = int(indices[-1] - indices[0]) + 1
    name, space = (MEDIAPIPE, "opencv") if count == 21 else (WEBXR, "y_up")
    kept = points[indices] if count == 21 else points[indices][:, _MEDIAPIPE_IN_WEBXR]
    has_translation = count != 21 or _has_translation(kept)
    missing = span - len(indices)
    info = FileInfo(name, side, True, 0, space, "m", _fps(document), span, missing, notes, has_translation)
    return LandmarkFile(document.path, kept, indices, info)


def _has_translation(points: np.ndarray) -> bool:
    """Whether a hand [N, 21, 3] moves; MediaPipe's world landmarks are relative to the hand's own centre."""
    centre = points.mean(1, keepdims=True)
    radius = np.linalg.norm(points - centre, axis=-1).max()
    return bool(np.linalg.norm(centre, axis=-1).max() > radius / 2)


def _content(document: Document) -> Any:
    """The frames as a list or array, or the columns of a table."""
    content = document.content
    if isinstance(content, dict) and document.path.suffix.lower() != ".csv":
        content = next((content[name] for name in _POINT_KEYS if name in content), None)
    return content


def _count(document: Document) -> int:
    """Landmarks per frame, in the first frame that has any."""
    content = _content(document)
    if isinstance(content, dict):
        return len({match[1] for match in map(_COLUMN.fullmatch, content) if match})
    if isinstance(content, np.ndarray):
        if content.ndim == 2:
            return {63: 21, 75: 25, 400: 25}.get(content.shape[1], 0)
        return content.shape[1] if content.ndim > 2 and content.shape[-1] in (3, 4, 16) else 0
    return len(next((points for points in map(_points_of, content) if points), []))


def _frames(document: Document, count: int) -> np.ndarray:
    """[N, count, 3]; NaN in frames without a hand."""
    content = _content(document)
    if isinstance(content, dict):
        return _points_of_columns(document, content, count)
    if not isinstance(content, np.ndarray):
        no_hand = [[np.nan] * 3] * count
        try:
            content = np.array(
                [[_position(point) for point in _points_of(frame)] or no_hand for frame in content], float
            )
        except (ValueError, TypeError, KeyError, OverflowError) as error:
            raise LiveHandError(
                f"{document.path}: each frame must be null or {count} points of x, y and z, got {error!r}"
            ) from error
    if content.dtype.kind not in "iuf":
        raise LiveHandError(f"{document.path}: landmarks must hold numbers, got {content.dtype}")
    values = content.astype(np.float64).reshape(len(content), count, -1)
    if values.shape[-1] == 16:
        is_row_major = content.shape[-2:] == (4, 4) and not values[..., 12:15].any()
        return values[..., 3:12:4] if is_row_major else values[..., 12:15]
    if values.shape[-1] != 3:
        raise LiveHandError(f"{document.path}: points must have x, y and z, got {values.shape[-1]} numbers each")
    return values


def _points_of(frame: Any) -> list:
    """The points of a frame; of the first hand in MediaPipe's own nesting."""
    if isinstance(frame, dict):
        frame = next((frame[name] for name in _POINT_KEYS if name in frame), None)
    if not frame:
        return []
    return frame[0] if len(frame) == 1 else frame


def _position(point: Any) -> list[float]:
    """x, y, z of a point with named coordinates, a list, or a flat 4 x 4 matrix in column-major order."""
    if isinstance(point, dict):
        point = point.get("position", point.get("matrix", point))
    if isinstance(point, dict):
        return [point["x"], point["y"], point["z"]]
    if len(point) == 16:
        return point[12:15]
    if len(point) != 3:
        raise ValueError(f"a point of {len(point)} numbers")
    return point


def _points_of_columns(document: Document, columns: dict[str, np.ndarray], count: int) -> np.ndarray:
    """[N, count, 3] from columns such as x0, y0, z0 or landmark_3_z."""
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
    """The side of the landmarks' shape, and notes."""
    label = _labelled_side(document)
    if not is_mediapipe:
        return label or "right", () if label else ("the file does not say which hand it is: a right one is assumed",)
    if label is None:
        return "right", ("the file has no label: a right hand in a picture that was not mirrored is assumed",)
    side = _other(label)
    return side, (f"MediaPipe's label '{label}' assumes a mirrored picture: the landmarks are those of a {side} hand",)


def _labelled_side(document: Document) -> Side | None:
    """The side in most of the file's labels; None if there is none."""
    content = document.content
    holders = [content] if isinstance(content, dict) else [f for f in content if isinstance(f, dict)]
    labels = [str(holder[name]).lower() for holder in holders for name in _SIDE_KEYS if name in holder]
    lefts, rights = (sum(side in label for label in labels) for side in ("left", "right"))
    if lefts == rights:
        return None
    return "left" if lefts > rights else "right"


def _fps(document: Document) -> float | None:
    return document.array(document.entries["fps"], "fps", (), (1,)).item() if "fps" in document.entries else None


def _other(side: Side) -> Side:
    return "left" if side == "right" else "right"
