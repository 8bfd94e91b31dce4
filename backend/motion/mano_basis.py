"""MANO's mean pose and its principal components: many files count from the one, in terms of the other.

They are MANO's, under its licence, and never shipped: they come from the user's own MANO file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE
from ..hand.model_file import load_hands_components, load_hands_mean
from ..records.errors import LiveHandError
from ..records.shot import Side


@dataclass(frozen=True)
class ManoBasis:
    """What a MANO file says of poses.

    Attributes:
        mean: [15, 3] rad.
        components: [45, 45], each row a direction of [15, 3] rad; coefficients count in standard deviations.
        side: of the file they are from.
    """

    mean: np.ndarray
    components: np.ndarray
    side: Side

    def for_side(self, side: Side) -> ManoBasis:
        """The other hand's are the exact mirror image."""
        if side == self.side:
            return self
        mirror = np.tile(MIRROR_AXIS_ANGLE, 15)
        return ManoBasis(self.mean * MIRROR_AXIS_ANGLE, self.components * mirror, side)


def load_mano_basis(path: Path | str, side: Side | None = None) -> ManoBasis:
    """Of one of MANO's own files, or a `.npz` with its keys; None reads the side from the file's name, as for models.

    Raises:
        LiveHandError: no such file, or it lacks them.
    """
    side = side or ("left" if "left" in Path(path).stem.lower() else "right")
    return ManoBasis(load_hands_mean(path), load_hands_components(path), side)


def basis_for(mano_path: Path | None, hand_path: Path | None) -> ManoBasis | None:
    """Of the MANO file that the user names, or else of the hand's own file where that is one; None: neither.

    Raises:
        LiveHandError: the user's file is missing, or lacks them.
    """
    if mano_path is not None:
        return load_mano_basis(mano_path)
    try:
        return load_mano_basis(hand_path) if hand_path else None
    except LiveHandError:
        return None


def needed_basis(basis: ManoBasis | None, side: Side, why: str) -> ManoBasis:
    """The basis of a side.

    Raises:
        LiveHandError: there is none.
    """
    if basis is None:
        raise LiveHandError(
            f"{why} must be given MANO's hands_mean and hands_components, got no MANO file; choose your MANO_RIGHT.pkl "
            "or MANO_LEFT.pkl (from MANO's website, under its licence)"
        )
    return basis.for_side(side)
