"""Which hand: right or left."""

from __future__ import annotations

from typing import Literal, get_args

Side = Literal["right", "left"]
SIDES: tuple[Side, ...] = get_args(Side)
