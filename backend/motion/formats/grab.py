"""GRAB's sequences: `.npz` with pickled dictionaries `rhand` and `lhand`, each with `params`; Z up, absolute angles."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import Side
from ..document import Document
from ..pose_file import PoseFile, RawHand, pose_file, raw_hand
from .format import Format

_NAME = "GRAB"
_KEYS: dict[Side, str] = {"right": "rhand", "left": "lhand"}
_FPS = 120.0


def _matches(document: Document) -> bool:
    return any(key in document.packed or isinstance(document.entries.get(key), dict) for key in _KEYS.values())


def _read(document: Document) -> PoseFile:
    hands: dict[Side, RawHand] = {}
    for side, key in _KEYS.items():
        hand = document.unpacked(key)
        if hand is not None:
            hands[side] = _hand(document, key, hand)
    uses_pca = any(raw.fingers.shape[1] != 45 for raw in hands.values())
    fps = document.entries.get("framerate")
    rate = _FPS if fps is None else document.array(fps, "framerate", (), (1,)).item()
    return pose_file(document.path, hands, _NAME, "z_up", has_mean_added=True, uses_pca=uses_pca, fps=rate)


def _hand(document: Document, key: str, hand: Any) -> RawHand:
    params = hand.get("params") if isinstance(hand, dict) else None
    if not isinstance(params, dict) or "global_orient" not in params or not {"fullpose", "hand_pose"} & params.keys():
        raise LiveHandError(f"{document.path}: {key} must hold params with global_orient and fullpose or hand_pose")
    root = document.array(params["global_orient"], f"{key} global_orient", (None, 3))
    count = len(root)
    name = "fullpose" if "fullpose" in params else "hand_pose"
    shapes = ((count, 45), (count, 15, 3)) if name == "fullpose" else ((count, None),)
    fingers = document.array(params[name], f"{key} {name}", *shapes).reshape(count, -1)
    transl = params.get("transl")
    place = None if transl is None else document.array(transl, f"{key} transl", (count, 3))
    return raw_hand(np.concatenate([root, fingers], 1), transl=place)


FORMAT = Format(_NAME, _matches, _read)
