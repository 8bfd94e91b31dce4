"""Which version of the built-in hands' skin a capture shows: its forms and fine detail, made by `builtin`."""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

from ..hand.model_file import builtin_hand_path
from .detail_maps_file import COARSE_FILE, FINE_FILE
from .fine_surface import FILE

SKIN_VERSION = "skin_version"
"""Its key in a capture's provenance; captures of the first versions, of other hands and of films lack it."""


@cache
def skin_version() -> str:
    """Of the skin that this software has: the start of the sha256 of its files."""
    beside = builtin_hand_path().with_name
    content = b"".join(beside(name).read_bytes() for name in (FILE, FINE_FILE, COARSE_FILE))
    return hashlib.sha256(content).hexdigest()[:12]


def is_current_skin(capture: Any) -> bool | None:
    """Whether a capture, by its provenance, shows the skin that this software has; None: it does not tell."""
    if not isinstance(capture, dict) or SKIN_VERSION not in capture:
        return None
    return capture[SKIN_VERSION] == skin_version()
