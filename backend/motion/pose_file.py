"""A pose file: its raw numbers, how they are interpreted, and the motion that follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE
from ..records.errors import LiveHandError
from ..records.side import SIDES, Side
from .gate import mean_doubt
from .mano_basis import ManoBasis, require_basis
from .motion import HandMotion
from .resampling import sampled_at
from .spaces import SPACES, Space

Unit = Literal["m", "cm", "mm"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}


class NoHandError(LiveHandError):
    """A valid one-frame file without a hand; in a sequence of files it is a gap."""


@dataclass(frozen=True)
class RawHand:
    """The numbers of one hand as the file stores them, for N frames.

    Attributes:
        root: [N, 3] axis-angle of the wrist, rad.
        fingers: [N, 45] axis-angle, rad, or [N, n] coefficients of MANO's principal components.
        beta: [10] or [N, 10].
        transl: [N, 3] in the file's unit.
        forearm: [3] or [N, 3] rad, as `HandMotion` has it.
        frame_indices: [N] increasing from the file's first frame, 0; it has no hand in the frames between them.
        angles_side: the hand whose angles they are, mirrored for the other one; None: the hand's own.
        has_translation: the file stores the wrist's position; otherwise transl is zero.
    """

    root: np.ndarray
    fingers: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    forearm: np.ndarray
    frame_indices: np.ndarray
    angles_side: Side | None = None
    has_translation: bool = True


@dataclass(frozen=True)
class FileInfo:
    """How a file is interpreted. The user may change every field except the format and the counts.

    Attributes:
        format: its name, for people.
        side: of the hand that is read.
        has_mean_added: finger angles are absolute; otherwise MANO's mean pose must be added.
        pca_components: the number of MANO's principal components that the fingers are given in; 0 for angles.
        space: axes of the wrist's rotation and translation.
        unit: of the translation.
        fps: frames per second; None if the file does not say.
        frames: of the motion, including gaps.
        missing: how many of them have no hand.
        notes: what else the user should know.
        has_translation: the file stores the wrist's position.
        first: how many frames of the file are before the motion's first, because the hand comes later.
        is_side_guessed: the file does not say which hand it is.
    """

    format: str
    side: Side
    has_mean_added: bool
    pca_components: int
    space: Space
    unit: Unit
    fps: float | None
    frames: int
    missing: int = 0
    notes: tuple[str, ...] = ()
    has_translation: bool = True
    first: int = 0
    is_side_guessed: bool = False


@dataclass(frozen=True)
class PoseFile:
    """The raw hands of a file and their interpretation."""

    path: Path
    hands: Mapping[Side, RawHand]
    info: FileInfo

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hands in the file."""
        return tuple(self.hands)

    def with_changes(self, **changes: Any) -> PoseFile:
        """Replace fields of `FileInfo` and keep the numbers.

        A side that the file has selects that hand. In a file with one hand, the other side corrects which hand it is.

        Raises:
            LiveHandError: a value is not allowed.
        """
        check_changes(changes)
        info = replace(self.info, **changes)
        raw = self._raw(info.side)
        width = raw.fingers.shape[1]
        _check("pca_components", info.pca_components, (0, 45) if width == 45 else (width,))
        return replace(self, info=with_frames(info, raw.frame_indices))

    def motion(self, basis: ManoBasis | None = None) -> HandMotion:
        """Convert to metres and absolute angles, in the file's own space; gaps are filled by slerp.

        Args:
            basis: MANO's mean and components, if the angles count from them.

        Raises:
            LiveHandError: the basis is needed and missing, or the frame rate is not positive.
        """
        info, raw = self.info, self._raw(self.info.side)
        theta = np.concatenate([raw.root[:, None], self._absolute_fingers(basis)], 1)
        if self._side_of_angles(raw) != info.side:
            theta = theta * MIRROR_AXIS_ANGLE
        motion = HandMotion(theta, raw.beta, raw.transl * METRES[info.unit], info.fps, info.side, raw.forearm)
        return with_gaps_filled(motion, raw.frame_indices)

    def warning(self, basis: ManoBasis | None = None) -> str | None:
        """Word why `has_mean_added` is probably wrong; None if the numbers agree with it or there are too few."""
        raw = self._raw(self.info.side)
        if self.info.pca_components:
            return None
        mean = None if basis is None else basis.for_side(self._side_of_angles(raw)).mean.ravel()
        return mean_doubt(raw.fingers, self.info.has_mean_added, mean)

    def _absolute_fingers(self, basis: ManoBasis | None) -> np.ndarray:
        """Convert the fingers to absolute angles [N, 15, 3], rad."""
        info, raw = self.info, self._raw(self.info.side)
        if info.has_mean_added and not info.pca_components:
            return raw.fingers.reshape(-1, 15, 3)
        user = f"poses in {info.format} that count from MANO's mean or components"
        mano = require_basis(basis, self._side_of_angles(raw), user)
        count = info.pca_components
        angles = raw.fingers @ mano.components[:count] if count else raw.fingers
        return angles.reshape(-1, 15, 3) + (0 if info.has_mean_added else mano.mean)

    def _raw(self, side: Side) -> RawHand:
        return self.hands.get(side) or next(iter(self.hands.values()))

    def _side_of_angles(self, raw: RawHand) -> Side:
        return raw.angles_side or self.info.side


def with_frames(info: FileInfo, frame_indices: np.ndarray) -> FileInfo:
    """Count the frames of a hand that is in these [N] of the file, increasing from its first, which is 0."""
    first, last = int(frame_indices[0]), int(frame_indices[-1])
    span = last - first + 1
    return replace(info, first=first, frames=span, missing=span - len(frame_indices))


def with_gaps_filled(motion: HandMotion, frame_indices: np.ndarray) -> HandMotion:
    """Fill a motion given at increasing frames [T], to every frame from the first to the last."""
    times = frame_indices - frame_indices[0]
    return motion if len(times) == times[-1] + 1 else sampled_at(motion, np.arange(times[-1] + 1), times)


def check_changes(changes: Mapping[str, Any]) -> None:
    """Raise a `LiveHandError` unless side, space and unit are among the allowed ones."""
    for name, allowed in (("side", SIDES), ("space", SPACES), ("unit", get_args(Unit))):
        if name in changes:
            _check(name, changes[name], allowed)


def pose_file(
    path: Path,
    hands: Mapping[Side, RawHand],
    name: str,
    space: Space,
    *,
    has_mean_added: bool,
    uses_pca: bool = False,
    fps: float | None = None,
    notes: tuple[str, ...] = (),
    is_side_guessed: bool = False,
) -> PoseFile:
    """Make a file of these hands, in metres, interpreted as its format says; the right hand is preferred.

    Raises:
        LiveHandError: the file has no hand.
    """
    found: dict[Side, RawHand] = {side: hands[side] for side in SIDES if side in hands}
    if not any(len(raw.root) for raw in found.values()):
        raise LiveHandError(f"{path}: {name} must hold at least one frame with a hand, got none")
    side, raw = next(iter(found.items()))
    width = raw.fingers.shape[1]
    if not 1 <= width <= 45:
        raise LiveHandError(f"{path}: fingers must be 1 to 45 numbers per frame, got {width}")
    info = FileInfo(
        name, side, has_mean_added, width if uses_pca else 0, space, "m", fps, 0, 0, notes, raw.has_translation
    )
    return PoseFile(path, found, replace(info, is_side_guessed=is_side_guessed)).with_changes()


def raw_hand(
    pose: np.ndarray,
    beta: np.ndarray | None = None,
    transl: np.ndarray | None = None,
    frame_indices: np.ndarray | None = None,
    angles_side: Side | None = None,
    forearm: np.ndarray | None = None,
) -> RawHand:
    """Split pose [N, 3 + n] into the wrist's axis-angle and the fingers; beta is cut or padded to ten.

    Without a forearm [3] or [N, 3], rad, it goes on straight.
    """
    count = len(pose)
    beta = np.zeros(10) if beta is None else beta
    ten = np.zeros((*beta.shape[:-1], 10))
    ten[..., : min(10, beta.shape[-1])] = beta[..., :10]
    return RawHand(
        pose[:, :3],
        pose[:, 3:],
        ten,
        np.zeros((count, 3)) if transl is None else transl,
        np.zeros(3) if forearm is None else forearm,
        np.arange(count) if frame_indices is None else frame_indices,
        angles_side,
        transl is not None,
    )


def _check(name: str, value: Any, allowed: tuple[Any, ...]) -> None:
    if value not in allowed:
        raise LiveHandError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}")
