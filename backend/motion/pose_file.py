"""How a pose file is read: what was detected, what may be changed, and the motion that follows from both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE
from ..records.errors import LiveHandError
from ..records.shot import SIDES, Side
from .mano_basis import ManoBasis, needed_basis
from .motion import HandMotion
from .spaces import SPACES, Space
from .resampling import at_frames

Unit = Literal["m", "cm", "mm"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

# A mean of the finger joints this near to zero, rad rms, is that of poses counted from MANO's mean; natural absolute
# poses lie about .3 from it. One this alike MANO's mean is that of absolute poses.
_NEAR_ZERO_RAD = 0.06
_ALIKE = 0.6
_FEWEST_FRAMES = 10


class NoHandError(LiveHandError):
    """A sound file of one frame in which no hand was seen: a gap, where it is one of many."""


@dataclass(frozen=True)
class RawHand:
    """One hand's numbers as the file has them, N entries.

    Attributes:
        root: [N, 3] axis-angle of the wrist, rad.
        fingers: [N, 45] axis-angle, rad, or [N, n] coefficients of MANO's principal components.
        beta: [10], or [N, 10].
        transl: [N, 3] in the file's unit.
        entries: [N] increasing: which of the file's frames these are; between them the hand was not there.
        is_in_right_terms: the angles are a right hand's, whatever the side; a left hand's are their mirror image.
        has_place: the file says where the wrist is; False: transl is zero and means nothing.
    """

    root: np.ndarray
    fingers: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    entries: np.ndarray
    is_in_right_terms: bool = False
    has_place: bool = True


@dataclass(frozen=True)
class Reading:
    """What the file is taken for; every field but the format and the counts may be changed.

    Attributes:
        format: its name, for people.
        side: of the hand that is read.
        has_mean_added: finger angles are absolute; False: MANO's mean is to be added.
        pca_components: how many components the fingers are given in; 0: they are angles.
        space: axes of the wrist's rotation and place.
        unit: of the place.
        fps: frames per second; None: the file does not say.
        frames: of the motion, gaps filled.
        missing: frames among them in which the file has no hand.
        notes: what else a user should know.
        has_place: the file says where the wrist is, not only how the hand is turned and bent.
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
    has_place: bool = True


@dataclass(frozen=True)
class PoseFile:
    """A file's raw numbers, and how they are read."""

    path: Path
    hands: Mapping[Side, RawHand]
    reading: Reading

    @property
    def sides(self) -> tuple[Side, ...]:
        """Which hands the file has."""
        return tuple(self.hands)

    def turned_round(self, **changes: Any) -> PoseFile:
        """The same raw numbers, read otherwise: fields of `Reading` by name.

        A side that the file has chooses that hand; where it has one hand only, the other side says that the file, or
        our guess, is wrong about which it is.

        Raises:
            LiveHandError: a value that cannot be.
        """
        check_changes(changes)
        reading = replace(self.reading, **changes)
        raw = self._raw(reading.side)
        width = raw.fingers.shape[1]
        _check("pca_components", reading.pca_components, (0, 45) if width == 45 else (width,))
        span = int(raw.entries[-1] - raw.entries[0]) + 1
        return replace(self, reading=replace(reading, frames=span, missing=span - len(raw.entries)))

    def motion(self, basis: ManoBasis | None = None) -> HandMotion:
        """The motion, absolute, in metres, in the file's own space; gaps are bridged by slerp.

        Args:
            basis: MANO's mean and components, where the reading counts from them.

        Raises:
            LiveHandError: the basis is needed and missing, or the rate is not positive.
        """
        reading, raw = self.reading, self._raw(self.reading.side)
        fingers = self._absolute_fingers(basis)
        theta = np.concatenate([raw.root[:, None], fingers], 1)
        if raw.is_in_right_terms and reading.side == "left":
            theta = theta * MIRROR_AXIS_ANGLE
        motion = HandMotion(theta, raw.beta, raw.transl * METRES[reading.unit], reading.fps, reading.side)
        if len(raw.entries) == reading.frames:
            return motion
        return at_frames(motion, np.arange(reading.frames), raw.entries - raw.entries[0])

    def doubt(self, basis: ManoBasis | None = None) -> str | None:
        """Why the mean may have been read wrongly; None where the numbers agree with the reading, or say nothing."""
        raw = self._raw(self.reading.side)
        if self.reading.pca_components or len(raw.fingers) < _FEWEST_FRAMES:
            return None
        mean = raw.fingers.mean(0)
        if self.reading.has_mean_added and np.sqrt((mean**2).mean()) < _NEAR_ZERO_RAD:
            return "the mean of all frames is a flat hand: the angles may count from MANO's mean"
        if not self.reading.has_mean_added and basis is not None:
            expected = basis.for_side("right" if raw.is_in_right_terms else self.reading.side).mean.ravel()
            if np.corrcoef(mean, expected)[0, 1] > _ALIKE:
                return "the mean of all frames is like MANO's mean: the angles may be absolute already"
        return None

    def _absolute_fingers(self, basis: ManoBasis | None) -> np.ndarray:
        """[N, 15, 3] rad."""
        reading, raw = self.reading, self._raw(self.reading.side)
        if reading.has_mean_added and not reading.pca_components:
            return raw.fingers.reshape(-1, 15, 3)
        side: Side = "right" if raw.is_in_right_terms else reading.side
        known = needed_basis(basis, side, f"poses in {reading.format} that count from MANO's mean or components")
        count = reading.pca_components
        angles = raw.fingers @ known.components[:count] if count else raw.fingers
        return angles.reshape(-1, 15, 3) + (0 if reading.has_mean_added else known.mean)

    def _raw(self, side: Side) -> RawHand:
        return self.hands.get(side) or next(iter(self.hands.values()))


def check_changes(changes: Mapping[str, Any]) -> None:
    """Raise a `LiveHandError` where a side, space or unit is none."""
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
) -> PoseFile:
    """A file of these hands, in metres, read as its format says; the right hand first, where it is there.

    Raises:
        LiveHandError: no hand in it.
    """
    found: dict[Side, RawHand] = {side: hands[side] for side in SIDES if side in hands}
    if not any(len(raw.root) for raw in found.values()):
        raise LiveHandError(f"{path}: {name} must hold at least one frame with a hand, got none")
    side, raw = next(iter(found.items()))
    if not 1 <= raw.fingers.shape[1] <= 45:
        raise LiveHandError(f"{path}: fingers must be 1 to 45 numbers per frame, got {raw.fingers.shape[1]}")
    components = raw.fingers.shape[1] if uses_pca else 0
    count, has_place = len(raw.entries), raw.has_place
    reading = Reading(name, side, has_mean_added, components, space, "m", fps, count, 0, notes, has_place)
    return PoseFile(path, found, reading).turned_round()


def raw_hand(
    pose: np.ndarray,
    beta: np.ndarray | None = None,
    transl: np.ndarray | None = None,
    entries: np.ndarray | None = None,
    is_in_right_terms: bool = False,
) -> RawHand:
    """Of pose [N, 3 + n]: the wrist's axis-angle, then the fingers; shapes are cut or filled to ten."""
    count = len(pose)
    beta = np.zeros(10) if beta is None else beta
    ten = np.zeros((*beta.shape[:-1], 10))
    ten[..., : min(10, beta.shape[-1])] = beta[..., :10]
    place = np.zeros((count, 3)) if transl is None else transl
    entries = np.arange(count) if entries is None else entries
    return RawHand(pose[:, :3], pose[:, 3:], ten, place, entries, is_in_right_terms, transl is not None)


def _check(name: str, value: Any, allowed: tuple[Any, ...]) -> None:
    if value not in allowed:
        raise LiveHandError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}")
