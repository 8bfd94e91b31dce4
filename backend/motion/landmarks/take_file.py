"""A filmed take on disk: what `livehand track` writes, landmarks in the picture with their camera and times.

A `.npz` of plain arrays: `size_px` [2], `focal_px`, `times` [T] s, `fps`, and for each side that was seen
`right_frames` [N], `right_px` [N, 21, 2] and `right_world` [N, 21, 3] m. The hand is fitted when the file is read, so
that any hand model may play it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ...system.files import replacing
from ..document import Document
from ..gate import motion_doubts
from ..motion import FPS_RANGE, MOST_FRAMES, HandMotion
from ..pose_file import FileInfo, check_changes, with_frames
from ..resampling import smoothed
from .live_gate import lost_doubt, mirror_doubt
from .picture_camera import PictureCamera
from .take_fit import FilmCamera, FilmedHand, TakeFit, fit_take

_NAME = "filmed take"
_MIRROR = np.array([-1.0, 1, 1])
_LEAST_STEP_S = 1e-5
_MOST_WORLD_M = 100.0
_MOST_TILT = 1e3  # of points, in focal lengths from the picture's middle


@dataclass(frozen=True)
class FilmedTake:
    """The hands of a film.

    Attributes:
        camera: its focal length may be a guess.
        times: [T] s, increasing, of all frames.
        fps: of the motion.
        hands: by the side that the picture shows.
    """

    camera: FilmCamera
    times: np.ndarray
    fps: float
    hands: Mapping[Side, FilmedHand]


@dataclass(frozen=True)
class TakeFile:
    """A take's file and how it is interpreted.

    Attributes:
        path: the file.
        take: its content.
        info: the side, the rate and the counts; axes and unit are the camera's and metres.
        is_picture_mirrored: the film was mirrored, as selfies are; the motion undoes it.
        beta: [10] shape of the hand that plays it; None: the mean.
    """

    path: Path
    take: FilmedTake
    info: FileInfo
    is_picture_mirrored: bool = False
    beta: np.ndarray | None = None

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hands in the file."""
        return (self.info.side,) if len(self.take.hands) == 1 else SIDES

    def with_changes(
        self,
        *,
        is_picture_mirrored: bool | None = None,
        picture_camera: PictureCamera | None = None,
        beta: np.ndarray | None = None,
        **changes: Any,
    ) -> TakeFile:
        """Replace fields of `FileInfo`, the camera or the hand's shape, and keep the take.

        Raises:
            LiveHandError: a value is not allowed.
        """
        check_changes(changes)
        if changes.get("space", "opencv") != "opencv" or changes.get("unit", "m") != "m":
            raise LiveHandError(f"{self.path}: a filmed take has its camera's axes and metres; leave both as detected")
        is_mirrored = self.is_picture_mirrored if is_picture_mirrored is None else is_picture_mirrored
        info = replace(self.info, **changes)
        if is_mirrored != self.is_picture_mirrored and "side" not in changes and len(self.take.hands) == 1:
            info = replace(info, side=_other(info.side))
        take = self.take
        if picture_camera is not None:
            share = take.camera.size_px[0] / picture_camera.size_px[0]
            take = replace(take, camera=FilmCamera(take.camera.size_px, picture_camera.focal_px * share))
        file = replace(
            self, take=take, info=info, is_picture_mirrored=is_mirrored, beta=beta if beta is not None else self.beta
        )
        hand = file._hand
        info, first_s = with_frames(info, hand.frames), float(take.times[hand.frames[0]] - take.times[0])
        return replace(file, info=replace(info, first=round(first_s * (info.fps or take.fps))))

    def fit(self, model: HandModel) -> TakeFit:
        """Fit the hand to the take.

        Raises:
            LiveHandError: the landmarks are not a hand's.
        """
        hand, camera = self._hand, self.take.camera
        if self.is_picture_mirrored:
            hand = _unmirrored_hand(hand, camera)
        fps = self.info.fps or self.take.fps
        return fit_take(hand, self.take.times, camera, model, self.info.side, fps, self.beta)

    def motion(self, model: HandModel, smooth_frames: float = 0.0) -> HandMotion:
        """Fill the gaps of the fitted motion."""
        return smoothed(self.fit(model).motion, smooth_frames)

    def warning(self, model: HandModel) -> str | None:
        """Word why the take is doubtful; None if it is not."""
        return take_doubts(self.fit(model), model)

    @property
    def _hand(self) -> FilmedHand:
        shown = _other(self.info.side) if self.is_picture_mirrored else self.info.side
        return self.take.hands.get(shown) or next(iter(self.take.hands.values()))


def unmirrored(take: FilmedTake) -> FilmedTake:
    """Undo a mirrored film's mirroring of the take: its hands are those of the other side."""
    return replace(take, hands=unmirrored_hands(take.hands, take.camera))


def unmirrored_hands(hands: Mapping[Side, FilmedHand], camera: FilmCamera) -> dict[Side, FilmedHand]:
    """Undo the mirroring of the hands that a mirrored film shows."""
    return {_other(side): _unmirrored_hand(hand, camera) for side, hand in hands.items()}


def _unmirrored_hand(hand: FilmedHand, camera: FilmCamera) -> FilmedHand:
    return FilmedHand(hand.frames, hand.px * (-1, 1) + (camera.size_px[0], 0), hand.world * _MIRROR)


def take_doubts(fit: TakeFit, model: HandModel) -> str | None:
    """Word what the user should look at in a take fitted to a model; None if nothing."""
    found = [lost_doubt(fit.rejected / len(fit.motion)), mirror_doubt(fit.mirror)]
    return "; ".join([*(doubt for doubt in found if doubt), *motion_doubts(model, fit.motion)]) or None


def write_take(take: FilmedTake, path: Path) -> None:
    """Write a take, atomically.

    Raises:
        LiveHandError: the name does not end in .npz, or the folder cannot be written to.
    """
    if path.suffix.lower() != ".npz":
        raise LiveHandError(f"a take must be written to a .npz file, got {path.name}")
    arrays: dict[str, Any] = {
        "size_px": np.array(take.camera.size_px),
        "focal_px": np.array(take.camera.focal_px),
        "times": take.times,
        "fps": np.array(take.fps),
    }
    for side, hand in take.hands.items():
        arrays |= {f"{side}_frames": hand.frames, f"{side}_px": hand.px, f"{side}_world": hand.world}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def is_take(document: Document) -> bool:
    """Tell whether a document is a filmed take."""
    return {"size_px", "focal_px", "times"} <= document.entries.keys()


def read_take(document: Document) -> TakeFile:
    """Read a filmed take; of two hands, the right one is selected.

    Raises:
        LiveHandError: the document is malformed, or no frame has a hand.
    """
    entries, path = document.entries, document.path
    times = document.array(entries["times"], "times", (None,))
    width, height = document.array(entries["size_px"], "size_px", (2,))
    focal_px = document.array(entries["focal_px"], "focal_px", ()).item()
    fps = document.array(entries.get("fps", 30.0), "fps", ()).item()
    is_increasing = bool((np.diff(times) > _LEAST_STEP_S).all())
    _require(0 < len(times) <= MOST_FRAMES and is_increasing, path, "times must increase")
    _require(min(width, height) >= 1 and focal_px > 0, path, "size_px and focal_px must be positive")
    _require(FPS_RANGE[0] <= fps <= FPS_RANGE[1], path, f"fps must be a film's, got {fps}")
    _require(bool((times[-1] - times[0]) * fps <= MOST_FRAMES), path, f"it must last at most {MOST_FRAMES} frames")
    camera = FilmCamera((int(width), int(height)), focal_px)
    hands: dict[Side, FilmedHand] = {
        side: _hand(document, side, len(times), camera) for side in SIDES if f"{side}_frames" in entries
    }
    _require(bool(hands), path, "it must have at least one hand; film the hand again, the whole of it in the picture")
    side: Side = next(iter(hands))
    info = FileInfo(_NAME, side, True, 0, "opencv", "m", fps, 0, 0, (), True)
    return TakeFile(path, FilmedTake(camera, times, fps, hands), info).with_changes()


def _hand(document: Document, side: Side, count: int, camera: FilmCamera) -> FilmedHand:
    entries, path = document.entries, document.path
    frames = document.array(entries[f"{side}_frames"], f"{side}_frames", (None,)).astype(int)
    n = len(frames)
    _require(
        n > 0 and bool(0 <= frames[0] and frames[-1] < count and (np.diff(frames) > 0).all()),
        path,
        f"{side}_frames must increase from 0 to below {count}",
    )
    px = document.array(entries.get(f"{side}_px"), f"{side}_px", (n, 21, 2))
    world = document.array(entries.get(f"{side}_world"), f"{side}_world", (n, 21, 3))
    _require(bool((np.abs(px) < _MOST_TILT * camera.focal_px).all()), path, f"{side}_px must be image coordinates, px")
    _require(bool((np.abs(world) < _MOST_WORLD_M).all()), path, f"{side}_world must be a hand's, in metres")
    return FilmedHand(frames, px, world)


def _require(holds: bool, path: Path, rule: str) -> None:
    if not holds:
        raise LiveHandError(f"{path}: {rule}; track the video again")


def _other(side: Side) -> Side:
    return "left" if side == "right" else "right"
