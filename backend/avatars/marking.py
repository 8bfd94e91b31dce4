"""The watermark of an avatar: 64 bits in its header, by which its frames are marked, and in its map of albedo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..records.errors import LiveHandError
from ..surface.albedo_mark import MarkReading, marked_steps, read_mark
from ..surface.albedo_ratio import RATIO_ARRAY
from .avatar import Avatar
from .metadata import WATERMARK_KEY, watermark_of

_NEW_MAP = 512  # texels along the map of a surface that had none


def marked_avatar(avatar: Avatar, payload: bytes) -> Avatar:
    """Return the avatar with these 8 bytes in its header and, if it has a surface, in its map of albedo.

    A surface without a map gets one that changes nothing but by the mark.

    Raises:
        LiveHandError: it is marked already.
    """
    before = watermark_of(avatar.provenance)
    if before is not None:
        raise LiveHandError(f"'{avatar.name}' must not be marked yet, got the bits {before.hex()}; mark the original")
    provenance = {**avatar.provenance, WATERMARK_KEY: payload.hex()}
    if avatar.surface is None:
        return replace(avatar, provenance=provenance)
    arrays = dict(avatar.surface.arrays)
    steps = arrays.get(RATIO_ARRAY, np.zeros((_NEW_MAP, _NEW_MAP, 3), np.int8))
    arrays[RATIO_ARRAY] = marked_steps(steps, payload)
    return replace(avatar, provenance=provenance, surface=replace(avatar.surface, arrays=arrays))


def mark_in_albedo(arrays: Mapping[str, np.ndarray]) -> MarkReading | None:
    """Read the mark in the map of a surface's arrays; None: they have no map."""
    return read_mark(arrays[RATIO_ARRAY]) if RATIO_ARRAY in arrays else None
