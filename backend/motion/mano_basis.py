"""MANO's mean pose and principal components, which many pose files count from.

They come from the user's own MANO file, under MANO's licence, and are never shipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..hand.model import MIRROR_AXIS_ANGLE
from ..hand.model_file import load_hands_components, load_hands_mean
from ..records.errors import LiveHandError
from ..records.side import Side


@dataclass(frozen=True)
class ManoBasis:
    """The pose space of a MANO file.

    Attributes:
        mean: [15, 3] rad.
        components: [45, 45], each row a direction of [15, 3] rad; coefficients count in standard deviations.
        side: of the MANO file.
    """

    mean: np.ndarray
    components: np.ndarray
    side: Side

    def for_side(self, side: Side) -> ManoBasis:
        """Return the basis of a side; the other hand's is the exact mirror image."""
        if side == self.side:
            return self
        mirror = np.tile(MIRROR_AXIS_ANGLE, 15)
        return ManoBasis(self.mean * MIRROR_AXIS_ANGLE, self.components * mirror, side)


def load_mano_basis(path: Path | str) -> ManoBasis:
    """Read one of MANO's own files, or a `.npz` with its keys; the side is in the file's name.

    Raises:
        LiveHandError: the file is missing, or lacks mean or components.
    """
    side = "left" if "left" in Path(path).stem.lower() else "right"
    return ManoBasis(load_hands_mean(path), load_hands_components(path), side)


def find_basis(mano_path: Path | None, hand_path: Path | None) -> ManoBasis | None:
    """Find the basis of the MANO file that the user names, else of the hand's own file; None if neither has one.

    Raises:
        LiveHandError: the file that the user names is missing, or lacks mean or components.
    """
    if mano_path is not None:
        return load_mano_basis(mano_path)
    try:
        return load_mano_basis(hand_path) if hand_path else None
    except LiveHandError:
        return None


def require_basis(basis: ManoBasis | None, side: Side, user: str) -> ManoBasis:
    """Return the basis of a side, or raise; `user` says in the error message what needs it.

    Raises:
        LiveHandError: the basis is None.
    """
    if basis is None:
        raise LiveHandError(
            f"{user} must be given MANO's hands_mean and hands_components, got no MANO file; choose your "
            "MANO_RIGHT.pkl or MANO_LEFT.pkl (from MANO's website, under its licence)"
        )
    return basis.for_side(side)
