"""The base surface of the built-in hand, which people share: its arrays ship beside the hand model, once for all.

A surface that names the base leaves out the arrays that are the base's; this module puts them in and takes them out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from ..capture.person import Person
from ..hand.model_file import DEFAULT_HAND, builtin_hand_path, builtin_sha256
from ..records.errors import LiveHandError
from .hair_growth import REGIONS
from .stored_surface import StoredSurface, check_arrays

SURFACE_FILE = f"surface_of_{DEFAULT_HAND}.npz"
FINE_FILE, COARSE_FILE = f"skin_of_{DEFAULT_HAND}.npz", f"coarse_skin_of_{DEFAULT_HAND}.npz"
HAIR_FILE = f"hair_of_{DEFAULT_HAND}.npz"
"""Beside the hand model's own."""
_MAPS = ("relief", "dorsal", "palmar", "pigment_light", "pigment_deep")
_CONTENT: Mapping[str, Mapping[str, str]] = {
    SURFACE_FILE: {
        **{name: name for name in ("offset", "vein", "flexion")},
        **{name: f"form/{name}" for name in ("joint", "range_deg", "height")},
    },
    FINE_FILE: {"joint": "bend/joint", **{name: f"fine/{name}" for name in _MAPS}},
    COARSE_FILE: {
        **{name: name for name in ("nail", "roughness", "unresolved")},
        **{name: f"coarse/{name}" for name in _MAPS},
    },
    HAIR_FILE: {"share": "hair/share"},
}
"""The arrays of each file, by the name that a surface has for them."""


def has_base(hand_sha256: str) -> bool:
    """Return whether there is a base surface of this hand model."""
    return hand_sha256 == builtin_sha256()


def base_arrays(*files: str) -> dict[str, np.ndarray]:
    """Read the arrays of the base, by the names of `ARRAYS`, in whole steps; those of these files, or of all."""
    arrays: dict[str, np.ndarray] = {}
    for file in files or _CONTENT:
        with np.load(builtin_hand_path().with_name(file), allow_pickle=False) as archive:
            arrays |= {ours: archive[theirs] for theirs, ours in _CONTENT[file].items()}
    return arrays


def file_arrays(file: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Select the arrays of one of the base's files, by its own names for them."""
    return {theirs: arrays[ours] for theirs, ours in _CONTENT[file].items()}


def base_sha256() -> str:
    """Return the identity of the base that this software has: the sha256 of its files."""
    return files_sha256(tuple(_CONTENT))


@cache
def files_sha256(names: tuple[str, ...]) -> str:
    """Compute the sha256 of files beside the built-in hand model."""
    beside = builtin_hand_path().with_name
    return hashlib.sha256(b"".join(beside(name).read_bytes() for name in names)).hexdigest()


def surface_of_person(person: Person, hand_sha256: str) -> StoredSurface | None:
    """Make a person's surface with the base's arrays; None: the hand has none, or the person's nails are painted."""
    if not has_base(hand_sha256) or person.nail_polish is not None:
        return None
    return StoredSurface(hand_sha256, person, {}, base_sha256(), REGIONS)


def check_base(surface: StoredSurface, source: str) -> None:
    """Check that the base which a surface names is here.

    Raises:
        LiveHandError: it is another version's, or another hand's.
    """
    if surface.base is None:
        return
    if surface.base != base_sha256():
        raise LiveHandError(
            f"{source} must name the base surface that this version has ({base_sha256()[:12]}...), got "
            f"{surface.base[:12]}...; use the version that made it, or train it again"
        )
    if not has_base(surface.hand_sha256):
        raise LiveHandError(
            f"{source} must lie on the hand of its base surface, {DEFAULT_HAND}, got hand {surface.hand_sha256[:12]}..."
        )


def whole_surface(surface: StoredSurface, source: str = "the surface") -> StoredSurface:
    """Return the surface with all arrays its own.

    Raises:
        LiveHandError: its base is not here, or its own arrays do not fit those of the base.
    """
    if surface.base is None:
        return surface
    check_base(surface, source)
    arrays = {**base_arrays(), **surface.arrays}
    check_arrays(arrays, source, len(surface.hair))
    return replace(surface, arrays=arrays, base=None)


def on_base(surface: StoredSurface) -> StoredSurface:
    """Drop the arrays that the base has, too; the surface as it is, if its hand has no base or it names one."""
    if surface.base is not None or not has_base(surface.hand_sha256):
        return surface
    base = base_arrays()
    own = {name: values for name, values in surface.arrays.items() if not _equal(values, base.get(name))}
    return replace(surface, arrays=own, base=base_sha256())


def _equal(values: np.ndarray, others: np.ndarray | None) -> bool:
    return others is not None and values.dtype == others.dtype and np.array_equal(values, others)
