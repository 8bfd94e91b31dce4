"""ARCTIC's `.mano.npy`: a pickled dictionary of both hands; angles count from MANO's mean pose."""

from __future__ import annotations

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "ARCTIC MANO"
_KEYS = {"rot", "pose", "trans"}
_FPS = 30.0


def _hands(document: Document) -> dict[Side, dict]:
    hands: dict[Side, dict] = {}
    for side in SIDES:
        hand = document.entries.get(side)
        if isinstance(hand, dict) and hand.keys() >= _KEYS:
            hands[side] = hand
    return hands


def _matches(document: Document) -> bool:
    return bool(_hands(document))


def _read(document: Document) -> PoseFile:
    hands: dict[Side, RawHand] = {side: _read_hand(document, side, hand) for side, hand in _hands(document).items()}
    return pose_file(document.path, hands, _NAME, "z_up", has_mean_added=False, fps=_FPS)


def _read_hand(document: Document, side: Side, hand: dict) -> RawHand:
    root = document.array(hand["rot"], f"{side} rot", (None, 3))
    count = len(root)
    if count == 0:
        raise LiveHandError(f"{document.path}: {side} must hold frames, got none; download it again")
    fingers = document.array(hand["pose"], f"{side} pose", (count, 45))
    transl = document.array(hand["trans"], f"{side} trans", (count, 3))
    beta = document.array(hand.get("shape", np.zeros(10)), f"{side} shape", (10,), (count, 10))
    return raw_hand(np.concatenate([root, fingers], 1), beta, transl)


FORMAT = Format(_NAME, _matches, _read)
