"""The people whose hands synthetic captures show, as numbers: a table, and a reader of JSON files with such numbers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.readers import read_json

_BETAS = 10
_RANGES = {
    "melanin": (0.0, 1.2),
    "blood": (0.0, 2.0),
    "veins_mm": (0.0, 1.0),
    "folds": (0.0, 2.0),
    "freckles": (0.0, 3.0),
    "tendons": (0.0, 2.0),
    "beta": (-3.0, 3.0),
    "nail_polish": (0.0, 1.0),
}
_LENGTHS = {"beta": _BETAS, "nail_polish": 3}


@dataclass(frozen=True)
class Person:
    """A person's skin and shape.

    Attributes:
        melanin: pigment of the skin, 0 light to 1 deep.
        blood: how red the skin is; 1 is usual.
        veins_mm: height of the veins on the back of the hand.
        folds: depth of folds and creases; 1 is a young adult's, more is older.
        freckles: strength of freckles and spots; 1 is usual.
        tendons: how far those of lifted fingers stand out; 1 is a lean man's.
        beta: [10] shape coefficients.
        nail_polish: linear Rec.709, or None.
    """

    melanin: float = 0.0
    blood: float = 1.0
    veins_mm: float = 0.25
    folds: float = 1.0
    freckles: float = 1.0
    tendons: float = 1.0
    beta: tuple[float, ...] = (0.0,) * _BETAS
    nail_polish: tuple[float, float, float] | None = None

    def facts(self) -> dict:
        """Write out the person's numbers, as a JSON file holds them; usual tendons go without saying, as before."""
        facts = asdict(self)
        return {name: value for name, value in facts.items() if name != "tendons" or value != Person.tendons}


PERSONS = {
    "light": Person(),
    # A woman.
    "middle": Person(
        melanin=0.42, veins_mm=0.15, freckles=0.3, beta=(-0.8, -1.0, 0.6, -0.8, -0.5, 0.0, 0.0, 0.5, -0.8, -0.5)
    ),
    # An old man.
    "deep": Person(melanin=1.0, veins_mm=0.45, folds=1.42, beta=(0.4, 0.3, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, 0.0, -0.6)),
    "old": Person(
        melanin=0.08,
        blood=1.15,
        veins_mm=0.6,
        folds=1.6,
        freckles=2.2,
        beta=(0.0, -0.6, 0.0, 0.0, -0.9, 0.0, 0.0, 0.0, 0.0, -1.2),
    ),
}


def find_person(name_or_path: str) -> Person:
    """Find a person of the table, or read one of a JSON file with the attributes' names as keys.

    Raises:
        LiveHandError: neither is there, or the file has unknown keys or numbers out of range.
    """
    if name_or_path in PERSONS:
        return PERSONS[name_or_path]
    path = Path(name_or_path)
    if not path.is_file():
        raise LiveHandError(f"the person must be one of {', '.join(PERSONS)} or a JSON file, got {name_or_path!r}")
    return person_of(read_json(path), str(path))


def person_of(document: object, source: str) -> Person:
    """Read the person of a JSON object with the attributes' names as keys; what it leaves out is as usual.

    Args:
        document: the object.
        source: of it, for errors.

    Raises:
        LiveHandError: it has unknown keys, or numbers out of range.
    """
    known = [field.name for field in fields(Person)]
    if not isinstance(document, dict) or not set(document) <= set(known):
        raise LiveHandError(f"{source} must be a JSON object with keys of {', '.join(known)}")
    numbers: dict[str, Any] = {name: _value(name, value, source) for name, value in document.items()}
    return Person(**numbers)


def _value(name: str, value: object, source: str) -> float | tuple[float, ...] | None:
    if name == "nail_polish" and value is None:
        return None
    if name not in _LENGTHS:
        return _number(name, value, source)
    if not (isinstance(value, list | tuple) and len(value) == _LENGTHS[name]):
        raise LiveHandError(f"{source}: {name} must be a list of {_LENGTHS[name]} numbers, got {value!r}")
    return tuple(_number(name, one, source) for one in value)


def _number(name: str, value: object, source: str) -> float:
    smallest, largest = _RANGES[name]
    if isinstance(value, int | float) and not isinstance(value, bool):
        if math.isfinite(value) and smallest <= value <= largest:
            return float(value)
    raise LiveHandError(f"{source}: {name} must be a number between {smallest} and {largest}, got {value!r}")
