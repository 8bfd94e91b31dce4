"""An avatar's surface as files hold it: the person's numbers, and arrays over a hand model's mesh and atlas.

Arrays may be left out that a shared base has (`base_surface`), so that people who share them do not each carry a copy.
docs/dev/avatar_format.md documents the arrays, their units and frames for users.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..capture.person import Person, person_of
from ..records.errors import LiveHandError
from .hair_growth import HairRegion

_JOINTS = 16
_PYRAMID_BASE, _MOST_TEXELS = 64, 8192  # of the finest map: the smallest of its six levels is two texels wide
_REGION_LIMITS = HairRegion(per_m2=5e6, length_m=0.05, radius_m=1e-3, rise=0.7, ulnar=10.0)
_DESCRIPTION_KEYS = {"hand_sha256", "base", "person", "hair"}


class ArraySpec(NamedTuple):
    """What an array of a surface must be.

    Attributes:
        dtype: of its numbers.
        axes: their lengths; equal letters stand for equal lengths.
        low, high: limits of its numbers, both allowed; None: any finite ones.
        is_optional: whether a surface may lack it.
    """

    dtype: str
    axes: tuple[int | str, ...]
    low: float | None = None
    high: float | None = None
    is_optional: bool = False


_MAPS = ("relief", "dorsal", "palmar", "pigment_light", "pigment_deep")
ARRAYS: Mapping[str, ArraySpec] = {
    "offset": ArraySpec("int16", ("N", 3)),
    "vein": ArraySpec("int8", ("N",), 0, 100),
    "flexion": ArraySpec("float32", (_JOINTS, 3), -1.001, 1.001),
    "form/joint": ArraySpec("int8", ("F",), 0, _JOINTS - 1),
    "form/range_deg": ArraySpec("float32", ("F", 2), -360, 360),
    "form/height": ArraySpec("int8", ("F", "N")),
    "bend/joint": ArraySpec("int8", ("V",), 0, _JOINTS - 1),
    **{f"fine/{name}": ArraySpec("int8", ("R", "R")) for name in _MAPS},
    **{f"coarse/{name}": ArraySpec("int8", ("Q", "Q")) for name in _MAPS},
    "nail": ArraySpec("int8", ("Q", "Q"), 0, 100),
    "roughness": ArraySpec("int8", ("Q", "Q"), 0, 127),
    "unresolved": ArraySpec("int8", (2, "U", "U")),
    "hair/share": ArraySpec("float32", ("M", "H"), 0, 1),
    "albedo/ratio": ArraySpec("int8", ("A", "A", 3), -127, 127, is_optional=True),
    "padding": ArraySpec("int8", ("N",), is_optional=True),
    "drains": ArraySpec("uint8", ("N",), is_optional=True),
    "confidence": ArraySpec("uint8", ("C", "C"), is_optional=True),
    "marks/right": ArraySpec("uint8", ("K", "K"), is_optional=True),
    "marks/left": ArraySpec("uint8", ("L", "L"), is_optional=True),
}
"""Of a surface, by name: V, N, M: vertices of the hand model, vertices and faces of its second subdivision; F: forms
that poses raise; R, Q, U, A, C, K, L: texels along the atlas; H: regions of hair."""


@dataclass(frozen=True)
class StoredSurface:
    """A surface as files hold it.

    Attributes:
        hand_sha256: identity of the hand model that it lies on.
        person: whose numbers shape it.
        arrays: its own, by the names of `ARRAYS`, in whole steps.
        base: sha256 of the shared surface that has the others; None: all are its own.
        hair: its regions, in the order of the columns of `hair/share`.
    """

    hand_sha256: str
    person: Person
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    base: str | None
    hair: Mapping[str, HairRegion]

    def description(self) -> dict[str, Any]:
        """Return everything but the arrays, as the header of a file holds it."""
        regions = [{"name": name, **region._asdict()} for name, region in self.hair.items()]
        return {"hand_sha256": self.hand_sha256, "base": self.base, "person": self.person.facts(), "hair": regions}


def stored_surface(description: object, arrays: Mapping[str, np.ndarray], source: str) -> StoredSurface:
    """Build the surface of a file, checked.

    Args:
        description: as `StoredSurface.description` makes it.
        arrays: its own.
        source: of the surface, for errors.

    Raises:
        LiveHandError: a key, a number or an array is missing, unknown, of another shape or out of range.
    """
    if not isinstance(description, dict) or not description.keys() >= _DESCRIPTION_KEYS:
        raise LiveHandError(f"{source}: its description must have {', '.join(sorted(_DESCRIPTION_KEYS))}")
    hand_sha256, base = description["hand_sha256"], description["base"]
    if not isinstance(hand_sha256, str) or not isinstance(base, str | None):
        raise LiveHandError(f"{source}: hand_sha256 must be text and base text or null, got {hand_sha256!r}, {base!r}")
    person = person_of(description["person"], f"{source}: person")
    hair = _hair_of(description["hair"], source)
    surface = StoredSurface(hand_sha256, person, dict(arrays), base, hair)
    check_arrays(surface.arrays, source, len(hair), is_whole=base is None)
    return surface


def check_arrays(arrays: Mapping[str, np.ndarray], source: str, regions: int, is_whole: bool = True) -> None:
    """Check the arrays of a surface.

    Args:
        arrays: by name.
        source: of the surface, for errors.
        regions: of hair.
        is_whole: all must be there.

    Raises:
        LiveHandError: one is missing, unknown, of another type or shape, or has numbers out of range.
    """
    unknown = sorted(arrays.keys() - ARRAYS.keys())
    if unknown:
        raise LiveHandError(f"{source} has arrays that this version does not know: {', '.join(unknown)}; update it")
    missing = [name for name, spec in ARRAYS.items() if not (name in arrays or spec.is_optional)]
    if is_whole and missing:
        raise LiveHandError(f"{source} must have the arrays {', '.join(missing)}, got none; write it again")
    lengths: dict[str, int] = {}
    for name, values in arrays.items():
        _check_array(name, values, lengths, source)
    if lengths.get("H", regions) != regions:
        raise LiveHandError(
            f"{source}: hair/share must have a column for each of {regions} regions, got {lengths['H']}"
        )
    _check_lengths(lengths, source)
    if "form/range_deg" in arrays and (arrays["form/range_deg"][:, 0] == arrays["form/range_deg"][:, 1]).any():
        raise LiveHandError(f"{source}: form/range_deg must be from one angle to another, got two that are equal")


def _check_array(name: str, values: np.ndarray, lengths: dict[str, int], source: str) -> None:
    spec = ARRAYS[name]
    if values.dtype != spec.dtype or values.ndim != len(spec.axes):
        raise LiveHandError(f"{source}: {name} must be {_described(spec)}, got {values.dtype} {list(values.shape)}")
    for axis, length in zip(spec.axes, values.shape, strict=True):
        wanted = axis if isinstance(axis, int) else lengths.setdefault(axis, length)
        if length != wanted or length == 0:
            known = "".join(f", {key} = {value}" for key, value in lengths.items() if key in spec.axes)
            raise LiveHandError(f"{source}: {name} must be {_described(spec)}{known}, got {list(values.shape)}")
    low, high = float(values.min()), float(values.max())
    if not (math.isfinite(low) and math.isfinite(high)):
        raise LiveHandError(f"{source}: {name} must be finite, got NaN or infinity")
    if (spec.low is not None and low < spec.low) or (spec.high is not None and high > spec.high):
        raise LiveHandError(f"{source}: {name} must be within {_limits(spec)}, got {low:g} to {high:g}")


def _check_lengths(lengths: Mapping[str, int], source: str) -> None:
    """Check that the lengths fit each other: of two subdivisions of a closed mesh, and of a pyramid of maps."""
    vertices, finer, faces = (lengths.get(axis) for axis in ("V", "N", "M"))
    for axis, got, wanted in (
        ("N", finer, vertices and 16 * vertices - 30),
        ("M", faces, vertices and 32 * vertices - 64),
        ("M", faces, finer and 2 * finer - 4),
    ):
        if got is not None and wanted is not None and got != wanted:
            raise LiveHandError(
                f"{source} must be twice subdivided from a closed mesh, with {axis} = {wanted}, got {axis} = {got}"
            )
    fine, coarse = lengths.get("R"), lengths.get("Q")
    for maps, texels in (("fine maps", fine), ("albedo/ratio", lengths.get("A"))):
        if texels is not None and (texels % _PYRAMID_BASE or not _PYRAMID_BASE <= texels <= _MOST_TEXELS):
            raise LiveHandError(
                f"{source}: {maps} must be a multiple of {_PYRAMID_BASE} and at most {_MOST_TEXELS} texels wide, "
                f"got {texels}"
            )
    if fine is not None and coarse is not None and fine not in [coarse << halving for halving in range(6)]:
        raise LiveHandError(f"{source}: coarse maps must be {fine} texels wide, halved 0 to 5 times, got {coarse}")


def _hair_of(regions: Any, source: str) -> dict[str, HairRegion]:
    keys = {"name", *HairRegion._fields}
    is_list = isinstance(regions, list) and all(isinstance(one, dict) and one.keys() == keys for one in regions)
    if not is_list or len({str(one["name"]) for one in regions}) < len(regions):
        raise LiveHandError(
            f"{source}: hair must be a list of regions, each with a name of its own and "
            f"{', '.join(HairRegion._fields)}, got {str(regions)[:80]}"
        )
    return {str(region["name"]): _region(region, source) for region in regions}


def _region(values: dict[str, Any], source: str) -> HairRegion:
    for name, limit in _REGION_LIMITS._asdict().items():
        value, least = values[name], -limit if name == "ulnar" else 0.0
        if not isinstance(value, int | float) or isinstance(value, bool) or not least <= value <= limit:
            raise LiveHandError(
                f"{source}: {name} of the hair's region {values['name']!r} must be from {least:g} to {limit:g}, "
                f"got {value!r}"
            )
    return HairRegion(*(float(values[name]) for name in HairRegion._fields))


def _described(spec: ArraySpec) -> str:
    return f"{spec.dtype} [{', '.join(map(str, spec.axes))}]"


def _limits(spec: ArraySpec) -> str:
    low, high = ("-" if limit is None else f"{limit:g}" for limit in (spec.low, spec.high))
    return f"[{low}, {high}]"
