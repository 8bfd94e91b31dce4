"""A table as `.csv`: a row for each hand in each frame, with joints' angles (rad, axis-angle) and positions (m, Z up).

`formats.own_table` reads the angles back; the positions are for people and other programs.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...system.files import replacing
from ..formats.own_table import BETAS, FOREARM, FRAME, HAND, THETA, TIME, TRANSL
from .posed_joints import pose_joints
from .take import Take, TakenHand
from .writer import WriteOptions, Writer

_LANDMARKS = (
    "WRIST",
    *(f"THUMB_{part}" for part in ("CMC", "MCP", "IP", "TIP")),
    *(
        f"{finger}_FINGER_{part}"
        for finger in ("INDEX", "MIDDLE", "RING", "PINKY")
        for part in ("MCP", "PIP", "DIP", "TIP")
    ),
)
_POSITIONS_OF_LANDMARKS = tuple(f"{name}_{axis}" for name in _LANDMARKS for axis in "xyz")
_DECIMALS_M = 7


def _write(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([FRAME, TIME, HAND, *THETA, *TRANSL, *FOREARM, *BETAS, *_POSITIONS_OF_LANDMARKS])
    hands = [_rows(hand) for hand in take.hands]
    for number, time_s in enumerate(take.times_s):
        for hand, rows in zip(take.hands, hands, strict=True):
            if number in hand.frames:
                table.writerow([number + 1, float(time_s), hand.side, *next(rows)])
    with replacing(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
    return ()


def _rows(hand: TakenHand) -> Iterator[list[float]]:
    motion = hand.motion
    count = len(motion)
    positions = pose_joints(motion, hand.own_model, hand.scale).landmarks.reshape(count, -1).round(_DECIMALS_M)
    columns = (motion.theta.reshape(count, -1), motion.transl, motion.forearms, motion.betas, positions)
    return iter(np.concatenate(columns, 1).tolist())


CSV = Writer("csv", "table", (".csv",), _write)
