"""Landmark files: MediaPipe's 21 landmarks and WebXR's 25 joints of one or both hands, and what motion they make.

The landmarks have the shape of the hand that the picture shows. MediaPipe's label is that hand's in recent versions and
the opposite hand's in older ones, which take the picture for a mirrored selfie; so the bend of the fingers decides.
If the picture was mirrored, that shape is the mirror image of the real hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hand.model import MIRROR_POINT, HandModel
from ...hand.model_file import load_default_hand
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..motion import HandMotion
from ..pose_file import METRES, FileInfo, Unit, check_changes, with_frames, with_gaps_filled
from ..resampling import smoothed
from .fit import METRIC, MONOCULAR, LandmarkFit, fit_landmarks, palm_m, side_errors
from .picture_camera import PictureCamera, lifted
from .recording import is_recording, read_recording
from .tracks import Track, follow_hands

MEDIAPIPE, WEBXR, PICTURE = "MediaPipe landmarks", "WebXR joints", "MediaPipe picture landmarks"
SHIFTED = "picture landmarks, moved or scaled"
_SURE = 0.85  # of a side: the fit's error as a share of the other side's
_PICTURE_NOTE = (
    "the landmarks are image coordinates, px, not metres: record world landmarks, or state the picture's camera"
)
_SHIFTED_NOTE = (
    "the wrist moves across the picture but never in depth: the landmarks are a picture's that were moved or scaled "
    "since, not metres"
)
_UNREALS_UNIT: Unit = "cm"
_MIRRORED_NOTE = "a labelled hand bends as the other one: the axes are left-handed, as Unity's, and z is negated"
_UNREAL_NOTE = (
    "a labelled hand bends as the other one: the axes are left-handed, in cm as Unreal's, so y is negated and z is up"
)
_FAR_M = 0.015  # root mean square distance of landmarks, from which they are no hand's
_SCALES = (0.4, 2.5)  # of a hand against the built-in one
_KNUCKLES = (5, 9, 13, 17)
_NEGATED_Y, _NEGATED_Z = np.array([1.0, -1, 1]), np.array([1.0, 1, -1])


@dataclass(frozen=True)
class LandmarkFile:
    """The landmarks of a file and their interpretation.

    Attributes:
        path: the file.
        hands: by the side that their shape has.
        info: how the file is interpreted; the mean and the components do not apply.
        is_picture_mirrored: the tracked picture was mirrored, as selfies are; the motion undoes it.
        picture_camera: of the tracked picture, for landmarks that are points in it.
        torn: as of `Tracks`.
    """

    path: Path
    hands: Mapping[Side, Track]
    info: FileInfo
    is_picture_mirrored: bool = False
    picture_camera: PictureCamera | None = None
    torn: str | None = None

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hands in the file."""
        return (self.info.side,) if len(self.hands) == 1 else SIDES

    @property
    def points(self) -> np.ndarray:
        """[N, 21, 3] of the hand that is read, in MediaPipe's order, in the file's unit; only frames with it."""
        return self._track.points

    @property
    def frame_indices(self) -> np.ndarray:
        """[N] increasing; the file does not have the hand in the frames between them."""
        return self._track.frame_indices

    def with_changes(
        self,
        *,
        is_picture_mirrored: bool | None = None,
        picture_camera: PictureCamera | None = None,
        **changes: Any,
    ) -> LandmarkFile:
        """Replace fields of `FileInfo` and keep the landmarks.

        In a file with both hands, `side` selects one; otherwise it corrects which hand it is.

        Raises:
            LiveHandError: a value is not allowed.
        """
        check_changes(changes)
        info = replace(self.info, **changes)
        is_mirrored = self.is_picture_mirrored if is_picture_mirrored is None else is_picture_mirrored
        if is_mirrored != self.is_picture_mirrored and "side" not in changes and len(self.hands) == 1:
            info = replace(info, side=_other(info.side))
        camera = picture_camera or self.picture_camera
        file = replace(self, info=info, is_picture_mirrored=is_mirrored, picture_camera=camera)
        return replace(file, info=with_frames(info, file.frame_indices))

    def fit(self, model: HandModel) -> LandmarkFit:
        """Fit the hand model to the landmarks, in the frames with a hand.

        Raises:
            LiveHandError: the landmarks are not those of a hand in metres, or of a picture whose camera is not known.
        """
        noise = METRIC if self.info.format == WEBXR else MONOCULAR
        return fit_landmarks(self._points_m(model), model, self.info.side, self.info.fps, noise)

    def motion(self, model: HandModel, smooth_frames: float = 0.0) -> HandMotion:
        """Fill the gaps of the fitted motion, and smooth it by a Gaussian with this standard deviation in frames."""
        return smoothed(with_gaps_filled(self.fit(model).motion, self.frame_indices), smooth_frames)

    def warning(self, model: HandModel) -> str | None:
        """Word why side or landmarks are probably wrong, and which frames are not read; None: all is well."""
        return "; ".join(filter(None, (self._shape_doubt(model), self.torn))) or None

    def _shape_doubt(self, model: HandModel) -> str | None:
        errors = side_errors(self._points_m(model), model)
        likelier = min(SIDES, key=errors.__getitem__)
        if likelier != self.info.side:
            return f"the landmarks bend like a {likelier} hand"
        return f"the landmarks are {1e3 * errors[likelier]:.0f} mm from a hand's" if errors[likelier] > _FAR_M else None

    @property
    def _track(self) -> Track:
        shape = _other(self.info.side) if self.is_picture_mirrored else self.info.side
        return self.hands.get(shape) or next(iter(self.hands.values()))

    def _points_m(self, model: HandModel) -> np.ndarray:
        metres = self.points * METRES[self.info.unit]
        if self.info.format == SHIFTED:
            raise LiveHandError(
                f"{self.path} must hold world landmarks (metres), got those of a picture, moved or scaled since: the "
                "wrist's depth is the same in all frames; record world landmarks, or give the tracker's own output"
            )
        if self.info.format == PICTURE:
            if self.picture_camera is None:
                raise LiveHandError(
                    f"{self.path} must hold world landmarks (metres), got image coordinates, px; record world "
                    "landmarks, or state the picture's size and angle of view"
                )
            metres = lifted(self.points, self.picture_camera, palm_m(model))
        return metres * MIRROR_POINT if self.is_picture_mirrored else metres


def is_landmarks(document: Document) -> bool:
    """Tell whether a document holds landmarks of a hand."""
    return is_recording(document)


def read_landmarks(document: Document) -> LandmarkFile:
    """Read the landmarks of the hands in a document; of two, the right one is selected.

    Raises:
        LiveHandError: the document is malformed, or no frame has a hand.
    """
    recording = read_recording(document)
    try:
        found = follow_hands(recording)
    except LiveHandError as error:
        raise LiveHandError(f"{document.path}: {error}") from error
    name, space = (MEDIAPIPE, "opencv") if found.is_mediapipe else (WEBXR, "y_up")
    name = PICTURE if found.is_picture else SHIFTED if found.is_shifted else name
    unit = "m" if name in (PICTURE, SHIFTED) else likely_unit(found.hands)
    hands, notes = _by_shape(found.hands, found.is_mediapipe, None if name in (PICTURE, SHIFTED) else unit)
    space = "z_up" if _UNREAL_NOTE in notes else space
    has_translation = name != MEDIAPIPE or any(_has_translation(track.points) for track in found.hands)
    if unit != "m":
        notes = (*notes, f"the hand's size tells the unit: read as {unit}")
    notes = (*notes, *found.notes, *((_PICTURE_NOTE,) if name == PICTURE else ()))
    notes = (*notes, *((_SHIFTED_NOTE,) if name == SHIFTED else ()))
    side: Side = next(side for side in SIDES if side in hands)
    info = FileInfo(name, side, True, 0, space, unit, recording.fps, 0, 0, notes, has_translation)
    return LandmarkFile(document.path, hands, info, torn=found.torn).with_changes()


def likely_unit(tracks: Sequence[Track]) -> Unit:
    """Find the unit in which the palms have a hand's size; metres if none does."""
    points = np.concatenate([track.points for track in tracks])
    with np.errstate(over="ignore"):
        palm = float(np.median(np.linalg.norm(points[:, _KNUCKLES] - points[:, :1], axis=-1).mean(-1)))
    size = palm / palm_m(load_default_hand())
    fitting: list[Unit] = [unit for unit, metres in METRES.items() if _SCALES[0] < size * metres < _SCALES[1]]
    return fitting[0] if fitting else "m"


def _by_shape(
    tracks: tuple[Track, ...], is_mediapipe: bool, unit: Unit | None
) -> tuple[dict[Side, Track], tuple[str, ...]]:
    """Divide the tracks by the side that their shape has, and say how it was found; without a unit: a picture's."""
    bends: list[Side | None] = [None if unit is None else _bend(track.points * METRES[unit]) for track in tracks]
    if not is_mediapipe and _is_mirrored_space(tracks, bends):
        is_unreals = unit == _UNREALS_UNIT
        mirror, note = (_NEGATED_Y, _UNREAL_NOTE) if is_unreals else (_NEGATED_Z, _MIRRORED_NOTE)
        return {track.label: track._replace(points=track.points * mirror) for track in tracks if track.label}, (note,)
    labels: list[Side | None] = [_side_of_label(track, is_mediapipe) for track in tracks]
    if len({bend or label for bend, label in zip(bends, labels, strict=True)}) < len(tracks):
        bends = [None] * len(tracks)
    sides: list[Side] = [_likeliest(bend, label) for bend, label in zip(bends, labels, strict=True)]
    notes = [
        _note(track, side, bend is not None, is_mediapipe)
        for track, side, bend in zip(tracks, sides, bends, strict=True)
    ]
    return dict(zip(sides, tracks, strict=True)), tuple(note for note in notes if note)


def _is_mirrored_space(tracks: Sequence[Track], bends: Sequence[Side | None]) -> bool:
    """Tell whether every labelled hand that surely bends does so as the other: trackers of joints know their sides."""
    agrees = [bend == track.label for track, bend in zip(tracks, bends, strict=True) if bend and track.label]
    return bool(agrees) and not any(agrees) and all(track.label for track in tracks)


def _bend(points: np.ndarray) -> Side | None:
    """Tell like whose hand the fingers bend; None if that is not sure."""
    try:
        errors = side_errors(points, load_default_hand())
    except LiveHandError:  # not in metres: the user may yet change the unit
        return None
    side = min(SIDES, key=errors.__getitem__)
    return side if errors[side] < _SURE * errors[_other(side)] else None


def _likeliest(bend: Side | None, label: Side | None) -> Side:
    return bend or label or "right"


def _side_of_label(track: Track, is_mediapipe: bool) -> Side | None:
    if track.label is None or track.is_own or not is_mediapipe:
        return track.label
    return _other(track.label)


def _note(track: Track, side: Side, is_bent: bool, is_mediapipe: bool) -> str | None:
    if track.label is None:
        reason = "as its fingers bend" if is_bent else "of a picture that was not mirrored"
        return f"the file does not say which hand it is: read as a {side} one, {reason}"
    if is_bent:
        return None if side == track.label else f"labelled '{track.label}', but its fingers bend like a {side} hand's"
    if is_mediapipe and not track.is_own:
        return f"MediaPipe's label '{track.label}' is taken for a mirrored picture's: read as a {side} hand"
    return None


def _has_translation(points: np.ndarray) -> bool:
    """Tell whether a hand [N, 21, 3] moves; MediaPipe's world landmarks are relative to the hand's own centre."""
    centre = points.mean(1, keepdims=True)
    radius = np.linalg.norm(points - centre, axis=-1).max()
    return bool(np.linalg.norm(centre, axis=-1).max() > radius / 2)


def _other(side: Side) -> Side:
    return "left" if side == "right" else "right"
