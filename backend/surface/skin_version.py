"""Which version of the built-in hands' skin a capture shows: its forms and fine detail (`tools/builtin_hand`)."""

from __future__ import annotations

from typing import Any

from .base_surface import COARSE_FILE, FINE_FILE, SURFACE_FILE, files_sha256

SKIN_VERSION = "skin_version"
"""Its key in a capture's provenance; captures of the first versions, of other hands and of films lack it."""


def skin_version() -> str:
    """Return the start of the sha256 of the base surface's files, but for hair, which captures do not show."""
    return files_sha256((SURFACE_FILE, FINE_FILE, COARSE_FILE))[:12]


def is_current_skin(capture: Any) -> bool | None:
    """Return whether a capture shows the skin that this software has, by its provenance; None: it does not say."""
    if not isinstance(capture, dict) or SKIN_VERSION not in capture:
        return None
    return capture[SKIN_VERSION] == skin_version()
